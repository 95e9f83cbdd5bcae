"""The process of set-up joints: where the cart's arms stand, as base frames for the arms they carry."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs import runtime
from procs.lib.cart import CLASSIC, SI, Cart
from procs.lib.faults import fault_of
from procs.suj.bluetooth import BluetoothBoards
from procs.suj.classic import Classic
from procs.suj.interface_board import InterfaceBoard
from procs.suj.joints import SetupJoints
from procs.suj.reference import CarriedTip
from procs.suj.setups import Fields, Setups
from procs.suj.si import EmulatedBoards, Si
from shm.client import LoopClient

BEHIND_IO_NS: Final = 120_000


class IoMailbox:
    """io's mailbox: what is refused is told, once in a row."""

    def __init__(self, client: LoopClient, me: runtime.Me) -> None:
        """`client` is our place in it."""
        self._client, self._me, self._told = client, me, ""

    def send(self, name: str, values: Sequence[float], text: str) -> None:
        """Queue a command; a full mailbox is no error here, the multiplexer notices and begins anew."""
        self._client.send(name, values, text)

    def poll(self) -> None:
        """Look at the replies."""
        for reply in self._client.poll():
            if reply.outcome == "refused" and reply.text != self._told:
                self._told = reply.text
                self._me.events.warning("io-refused", f"{self._me.name}: io refuses: {reply.text}", self._me.name)


def clutches(me: runtime.Me, cart: Cart) -> Callable[[int], NDArray[np.bool_]]:
    """Whether a clutch button of an Si set-up arm is pressed: they are buttons of the arms they carry."""
    pressed = np.zeros(len(cart.arms), dtype=bool)
    found = []
    for place, setup in enumerate(cart.arms):
        arm = next((arm for arm in me.document.arms if arm.name == setup.carries), None)
        names = [name for name in (arm.inputs.suj_clutch, arm.inputs.suj_clutch_2) if name] if arm is not None else []
        if arm is None or not names:
            continue
        ring = me.reads(arm.io, "state")
        listed = [row.name for row in me.document.io(arm.io).digital_inputs]
        places = np.array([listed.index(name) for name in names if name in listed], dtype=np.intp)
        found.append((place, ring, ring.field("input"), places))

    def look(now_ns: int) -> NDArray[np.bool_]:
        for place, ring, inputs, places in found:
            if ring.newest():
                pressed[place] = inputs[places].any()
        return pressed

    return look


def tips(me: runtime.Me, cart: Cart) -> list[CarriedTip | None]:
    """The arms of the system that the set-up arms carry."""
    running = {row.name for row in me.document.processes}
    return [CarriedTip(arm.carries, me.reads(arm.carries, "state")) if arm.carries in running else None
            for arm in cart.arms]


def fault_text(number: int) -> str:
    """A fault of the fault table in words."""
    fault = fault_of(number)
    return f"{fault.text}; {fault.hint}" if fault is not None else f"io reports fault {number}"


def main() -> None:
    """Run one patient cart until asked to stop; its brakes then hold."""
    with runtime.process("suj") as me, contextlib.ExitStack() as held:
        cart = me.document.cart(me.name)
        state, setpoint = me.writes("state"), me.writes("setpoint")
        setups = Setups(cart, state.field)
        source: Classic | Si | None = None
        board = orders = None
        if cart.kind == CLASSIC and cart.io:
            orders = IoMailbox(me.commands(cart.io), me)
            board = InterfaceBoard(me.document.io(cart.io), cart.robot, me.reads(cart.io, "state"), orders)
            source = Classic(cart, setups, board, me.events, state.field, setpoint.field, fault_text)
        elif cart.kind == SI and cart.simulation != "KINEMATIC":
            source = si(me, cart, setups, state.field, held)
        joints = SetupJoints(cart, state.field, setups, source, me.events, tips(me, cart))
        mailbox = me.mailbox()
        mailbox.refuse_waiting(f"{me.name} has just started; ask again")
        me.ready()
        while me.tick():
            joints.step(me.now_ns, mailbox.drain(me.wall_ns))
            state.publish(me.now_ns)
            if board is not None and orders is not None:
                setpoint.publish(me.now_ns)
                orders.poll()
                me.follow(int(board.write_ns), BEHIND_IO_NS)


def si(me: runtime.Me, cart: Cart, setups: Setups, field: Fields, held: contextlib.ExitStack) -> Si:
    """The potentiometer boards of an Si cart, real or played."""
    addresses = [cart.base_board, *(arm.board for arm in cart.arms)]
    link = EmulatedBoards(cart) if cart.emulated else BluetoothBoards(addresses)
    held.callback(link.close)
    return Si(cart, setups, link, me.events, field, clutches(me, cart))


if __name__ == "__main__":
    main()
