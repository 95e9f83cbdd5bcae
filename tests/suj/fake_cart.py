"""A patient cart for long plays: io's records and orders, potentiometers and buttons as plain values."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.arm.arm_configs import CHAIN, EYE
from tests.guarded import FakeCell, Guarded
from tests.suj.harness import FakeSetupReports
from trocar.procs.document.cart import CLASSIC, FIXED, SI, Cart, CartArm, channel_inputs
from trocar.procs.suj.multiplexer import PLUGS
from trocar.shm.mailbox.origins import Origin

MS = 1_000_000
NAMES = ("ECM", "PSM1", "PSM2", "PSM3")
FLAGS = ("power_requested", "powered", "amps_on", "pid_enabled", "pid_generation", "bias_generation", "fault")
ROBOT = 1  # place of the cart's robot in its io, behind one of two axes
BUTTONS = tuple(f"SUJ_clutch_{plug + 1}" for plug in range(PLUGS))
MUX = {1.0: "+", 0.0: "0"}
INPUTS = ("spare", *channel_inputs("SUJ"), *BUTTONS, "motor_up", "motor_down")
SHIFTED = ((1.0, 0.0, 0.0, 0.1), (0.0, 0.0, -1.0, -0.2), (0.0, 1.0, 0.0, 0.3), (0.0, 0.0, 0.0, 1.0))


def setup_arm(name: str, place: int, **changes: Any) -> CartArm:
    values: dict[str, Any] = {
        "name": name, "carries": name, "chain": CHAIN, "joints": 3, "world": SHIFTED, "tip": EYE,
        "primary": ((0.25, -0.1), (1.0, -2.0), (0.7, 0.1)), "secondary": ((0.26, -0.12), (-1.1, 2.5), (0.8, -0.1)),
        "weight": (0.5, 0.25, 1.0), "plug": PLUGS - place, "release_current": (1.5, -2.2, 2.0, 0.5)[place],
        "engaged_current": 0.1 * place, "lifts": name == "PSM3", "board": f"aa:0{place}", "base_pot": 3 - place}
    return CartArm(**(values | changes))


def cart_of(kind: str) -> Cart:
    """A cart of a kind; KINEMATIC is a Classic one without boards."""
    arms = tuple(setup_arm(name, place) for place, name in enumerate(NAMES))
    if kind == "KINEMATIC":
        arms = (*(setup_arm(name, place, position=(0.1 * place, 0.2, -0.3)) for place, name in enumerate(NAMES[:3])),
                setup_arm("PSM3", 3))
    if kind == FIXED:
        arms = (*(setup_arm(name, place, chain=None, joints=0, pose=SHIFTED) for place, name in enumerate(NAMES[:2])),
                setup_arm("PSM2", 2, chain=None, joints=0))
    return Cart("SUJ", CLASSIC if kind == "KINEMATIC" else kind, "KINEMATIC" if kind == "KINEMATIC" else "NONE", 0.002,
                arms, "ECM", "IO1" if kind == CLASSIC else "", "SUJ", "ff:ff" if kind == SI else "")


class LoggedCell(FakeCell):
    """What is told of faults and of who switched off."""

    def __init__(self, log: list[str]) -> None:
        super().__init__()
        self.log = log

    def fault(self) -> None:
        super().fault()
        self.log.append("fault")

    def void_earlier(self, origin: Origin) -> None:
        super().void_earlier(origin)
        self.log.append(f"switched off by {origin.id}")


class LoggedReports(FakeSetupReports):
    """Everything that is reported, on a line each."""

    def __init__(self, log: list[str]) -> None:
        super().__init__()
        self.log = log

    def status(self, text: str, component: str = "") -> None:
        self.log.append(f"status of {component}: {text}")

    def report(self, code: Any, text: str, component: str = "", axis: int = -1, value: float = 0.0,
               limit: float = 0.0, board: int = -1) -> None:
        self.log.append(f"{code.code} of {component}: {text} (axis {axis}, {value:.5g}, {limit:.5g})")

    def operating_state(self, state: str, sub_state: str, is_homed: bool, is_busy: bool) -> None:
        self.log.append(f"operating state {state} {sub_state} {is_homed} {is_busy}")


class FakeCartIo(Guarded):
    """io, the interface board and what hangs on it; a record every ms. It is the ring, and the mailbox with its guard.
    """

    def __init__(self, log: list[str]) -> None:
        super().__init__("io", FakeCell())
        self.log, self.volts = log, np.zeros((PLUGS, 16))
        self.commands, self.pressed = self, set[str]()
        self.channel, self.has_supply, self.alive, self.valid, self.deaf = 3, True, True, True, False
        self.power_at_ns = self.lost = self.stamp_ns = 0
        self.epoch = 1
        self.flags = dict.fromkeys(FLAGS, 0)
        self._fields: dict[str, Any] = {
            "pot_voltage": np.zeros(2 + PLUGS), "input": np.zeros(len(INPUTS), dtype=bool), "write_ns": np.array(0),
            "robot_valid": np.zeros(2, dtype=bool), **{name: np.zeros(2, dtype=np.int64) for name in FLAGS}}
        self._waiting: list[tuple[int, dict[str, Any]]] = []

    @property
    def document(self) -> Any:
        """Of this io."""
        robots = [SimpleNamespace(name=name, actuators=(None,) * count) for name, count in (("PSM1", 2), ("SUJ", 4))]
        return SimpleNamespace(robots=robots, digital_inputs=[SimpleNamespace(name=name) for name in INPUTS])

    def on_behalf(self, origin: Origin) -> None:
        super().on_behalf(origin)
        self.log.append(f"io asked for {origin.id}")

    def send(self, name: str, values: Sequence[float], text: str) -> None:
        word = MUX[values[0]] if name == "multiplexer" else f"io < {name} {text} {tuple(values)}"
        if len(word) == 1 and self.log and self.log[-1].startswith("mux "):
            self.log[-1] += word
        else:
            self.log.append(f"mux {word}" if len(word) == 1 else word)
        if self.deaf or not self.lets_through(name, values, text):
            return
        if name == "multiplexer":
            self.channel = (self.channel + 1) % 16 if values[0] else 0
        elif name == "power_on":
            self.flags["power_requested"], self.flags["fault"], self.power_at_ns = 1, 0, self.stamp_ns + 40 * MS
        elif name == "power_off":
            self.cell.void_earlier(self.origin)
            self.flags |= {"power_requested": 0, "powered": 0, "amps_on": 0, "pid_enabled": 0}
        elif name == "pid_enable":
            self.flags |= {"pid_enabled": 1, "pid_generation": self.flags["pid_generation"] + 1}

    def restart(self) -> None:
        self.cell.fault()
        self.flags = dict.fromkeys(FLAGS, 0)
        self.epoch += 1

    def trip(self, number: int) -> None:
        self.cell.fault()
        self.flags |= {"fault": number, "pid_enabled": 0}

    def write(self, now_ns: int) -> None:
        """A record."""
        if not self.alive:
            return
        on = int(self.flags["power_requested"] and self.has_supply and now_ns >= self.power_at_ns)
        self.flags |= {"powered": on, "amps_on": int(on and now_ns >= self.power_at_ns + 20 * MS)}
        inputs = [name in self.pressed for name in INPUTS]
        for bit in range(4):
            inputs[1 + bit] = bool(self.channel >> bit & 1)
        record = {"pot_voltage": [9.0, 9.0, *self.volts[:, self.channel]], "input": inputs, "write_ns": now_ns,
                  "robot_valid": (True, self.valid), **{name: (7, value) for name, value in self.flags.items()}}
        self._waiting.append((now_ns, record))

    def field(self, name: str) -> Any:
        return self._fields[name]

    def next(self) -> bool:
        if not self._waiting:
            return False
        self.stamp_ns, record = self._waiting.pop(0)
        for name, value in record.items():
            self._fields[name][...] = value
        return True


@dataclass
class FakePotLink:
    """Boards of an Si cart, each with its own reading or what is wrong with it."""

    cart: Cart
    counts: Any = field(default_factory=lambda: np.full((4, 2, 3), 0.2))
    problems: dict[str, str] = field(default_factory=dict)
    silent: set[str] = field(default_factory=set)
    odd: dict[str, bytes] = field(default_factory=dict)
    period_ns: int = 0
    next_ns: int = 0

    def poll(self, now_ns: int) -> list[tuple[str, bytes]]:
        if now_ns < self.next_ns:
            return []
        self.next_ns = now_ns + self.period_ns
        base = np.zeros((2, 4))
        for arm, counts in zip(self.cart.arms, self.counts, strict=True):
            base[:, arm.base_pot] = counts[:, 0]
        rows = [(self.cart.base_board, base), ("ee:ee", base),
                *((arm.board.upper(), counts[:, 1:]) for arm, counts in zip(self.cart.arms, self.counts, strict=True))]
        return [(address, self.odd.get(address) or json.dumps({"pots": values.tolist()}).encode())
                for address, values in rows if address not in self.silent]

    def problem(self, address: str) -> str:
        return self.problems.get(address, "")
