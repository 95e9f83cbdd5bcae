"""The process of setup joints: publishes their positions as base frames for the arms they carry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.cart import CLASSIC, SI, Cart, CartArm
from trocar.procs.node import runtime
from trocar.procs.node.inputs import SETUP_LATE_S
from trocar.procs.node.io_faults import fault_reports, io_stalls, power_reports
from trocar.procs.node.node import Node
from trocar.procs.suj.bluetooth import BluetoothBoards
from trocar.procs.suj.buttons import Flags
from trocar.procs.suj.classic import Classic
from trocar.procs.suj.frames import CarriedTip
from trocar.procs.suj.interface_board import InterfaceBoard, IoMailbox
from trocar.procs.suj.joints import SetupContext, SetupJoints
from trocar.procs.suj.setups import Setups
from trocar.procs.suj.si import EmulatedBoards, PotLink, Si, UnreadPots
from trocar.shm.mailbox.origins import Origin
from trocar.shm.system.subscriptions import EVERY

BEHIND_IO_NS: Final = 120_000
AT_REST: Final = 30  # cycles without a change


def carried(node: Node, setup: CartArm) -> ArmConfig | None:
    """The arm of the system on a setup arm; None: it carries none."""
    return next((arm for arm in node.document.arms if arm.name == setup.carries), None)


def has_brakes(node: Node, arm: ArmConfig) -> bool:
    """Whether the io of this arm releases the brakes of the setup arm under it."""
    return any((row.set_by, row.robot) == ("setup_brake", arm.robot)
               for row in node.document.io(arm.io).digital_outputs)


def hands(node: Node, cart: Cart) -> Callable[[int], tuple[Flags, Flags]]:
    """Whether a clutch button of an Si setup arm is pressed, and whether its brakes have power: buttons and power are
    those of the carried arm. Brakes that io does not release count as powered.
    """
    pressed, powered = np.zeros(len(cart.arms), dtype=bool), np.ones(len(cart.arms), dtype=bool)
    found = []
    for place, setup in enumerate(cart.arms):
        arm = carried(node, setup)
        if arm is None:
            continue
        io, record = node.document.io(arm.io), node.input(arm.io, late_s=SETUP_LATE_S)
        buttons = np.flatnonzero([row.name in (arm.inputs.suj_clutch, arm.inputs.suj_clutch_2)
                                  for row in io.digital_inputs])
        robot = io.place(arm.robot).row
        amps_on = record.field("amps_on")[robot : robot + 1] if has_brakes(node, arm) else None
        found.append((place, record, record.field("input"), buttons, amps_on))

    def look(now_ns: int) -> tuple[Flags, Flags]:
        for place, record, inputs, buttons, amps_on in found:
            if record.look(now_ns):
                pressed[place] = inputs[buttons].any()
            powered[place] = amps_on is None or (record.fresh and amps_on[0])
        return pressed, powered

    return look


def brakes(node: Node, cart: Cart, orders: Callable[[str], IoMailbox]) -> Callable[[int, bool], None]:
    """Has the io of a carried arm release the brakes of an Si setup arm; `orders` gives the mailbox of an io."""
    arms = {place: carried(node, setup) for place, setup in enumerate(cart.arms)}
    found = {place: (orders(arm.io), arm.robot) for place, arm in arms.items() if arm and has_brakes(node, arm)}

    def let_go(place: int, on: bool) -> None:
        if place in found:
            mailbox, robot = found[place]
            mailbox.commands.send("setup_brake", (float(on),), robot)

    return let_go


def tips(node: Node, cart: Cart) -> list[CarriedTip | None]:
    """The arms of the system that the setup arms carry."""
    running = {row.name for row in node.document.processes}
    return [CarriedTip(arm.carries, node.input(arm.carries, late_s=SETUP_LATE_S)) if arm.carries in running else None
            for arm in cart.arms]


class SetupLoop(runtime.Loop):
    """One patient cart with its rings and mailboxes."""

    def setup(self) -> None:
        node = self.node
        cart = node.document.cart(node.name)
        self._state, self._setpoint = node.writes("state"), node.writes("setpoint")
        self._orders: dict[str, IoMailbox] = {}
        self._written: NDArray[Any] | None = None
        field, setups = self._state.field, Setups(cart, self._state.field)
        source: Classic | Si | None = None
        if cart.kind == CLASSIC and cart.io:
            io, records, events = node.document.io(cart.io), node.reads(cart.io, "state"), node.reads(cart.io, "events")
            robot = io.place(cart.robot)
            board = InterfaceBoard(io, robot, records, self._mailbox_of(cart.io),
                                   fault_reports(lambda: records.stamp_ns, events, cart.robot),
                                   power_reports(records.field, io, robot), io_stalls(events, cart.io))
            self._written = board.write_ns
            node.follows(cart.io)
            source = Classic(cart, setups, board, node.events, field, self._setpoint.field)
        elif cart.kind == SI and cart.simulation != "KINEMATIC":
            source = Si(cart, setups, node.hold(link_of(cart)), node.events, field, hands(node, cart),
                        brakes(node, cart, self._mailbox_of))
        self._resting = 0
        faults = node.fault_cell()
        self._joints = SetupJoints(cart, setups, source, SetupContext(
            field, node.events, tips(node, cart), faults, self._on_behalf, node.stall))
        self._mailbox = node.mailbox(faults)

    def _mailbox_of(self, io: str) -> IoMailbox:
        if io not in self._orders:
            self._orders[io] = IoMailbox(self.node.commands(io), self.node.events, self.node.name)
        return self._orders[io]

    def _on_behalf(self, origin: Origin) -> None:
        for mailbox in self._orders.values():
            mailbox.commands.on_behalf(origin)

    @property
    def may_rest(self) -> bool:
        return self._resting > AT_REST and not self.node.subscriptions.wanted & EVERY

    def has_news(self) -> bool:
        return self._mailbox.has_news

    def update(self) -> None:
        node, now_ns = self.node, self.node.now_ns
        self._joints.step(now_ns, self._mailbox.drain(node.wall_ns))
        node.subscriptions.look()
        self._resting = self._resting + 1 if self._joints.at_rest else 0
        self._state.publish(now_ns)
        for mailbox in self._orders.values():
            mailbox.poll()
        if self._written is not None:
            self._setpoint.publish(now_ns)
            node.follow(int(self._written), BEHIND_IO_NS)


def link_of(cart: Cart) -> PotLink:
    """The potentiometer boards of an Si cart, real or emulated."""
    if cart.by_arm and not cart.emulated:
        return UnreadPots()
    return EmulatedBoards(cart) if cart.emulated else BluetoothBoards(
        [board for board in (cart.base_board, *(arm.board for arm in cart.arms)) if board])


def main() -> None:
    """Run one patient cart until stopped; its brakes then hold."""
    runtime.run("suj", SetupLoop)


if __name__ == "__main__":
    main()
