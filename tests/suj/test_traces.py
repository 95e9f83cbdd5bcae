"""Long plays of patient carts: what setup joints do in each step of them; see tests.traces."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from tests.arm.fake_requests import FakeRequest
from tests.suj.fake_cart import BUTTONS, MS, NAMES, FakeCartIo, FakePotLink, LoggedCell, LoggedReports, cart_of
from tests.suj.harness import FakeMemory, FakeRing
from tests.traces import Mishaps, Trace, shown
from trocar.procs.document.cart import CLASSIC, FIXED, SI
from trocar.procs.document.system import RecordPlace
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.procs.node.inputs import SETUP_LATE_S, Input
from trocar.procs.suj.classic import Classic
from trocar.procs.suj.frames import CarriedTip
from trocar.procs.suj.interface_board import InterfaceBoard
from trocar.procs.suj.joints import SetupContext, SetupJoints
from trocar.procs.suj.multiplexer import Multiplexer
from trocar.procs.suj.pots import Potentiometers
from trocar.procs.suj.setups import Setups
from trocar.procs.suj.si import Si
from trocar.procs.tables.codes import ARM_LOST
from trocar.shm.mailbox.origins import Origin
from trocar.shm.topics import SUJ_SETPOINT, SUJ_STATE

FOLDER = Path(__file__).parent / "traces"
STEPS = {CLASSIC: 2500, SI: 900, "KINEMATIC": 400, FIXED: 300}
PROBLEM_FAULT = 9
SETPOINTS = ("mode", "count", "effort", "in_effort", "pid_generation", "bias_generation")
ASKED = (
    *(("state_command", (), word) for word in ("enable", "home", "home", "disable", "unhome", " enable ", "pause", "")),
    *(("clutch", (value,), name) for name in ("ECM", " PSM2 ", "nobody") for value in (1.0, 0.0)),
    ("clutch", (), "ECM"), *(("set_lift_velocity", (value,), "") for value in (-1.0, 0.5, 0.0, 1.0, 1.01, math.nan)),
    ("set_lift_velocity", (), ""), ("servo_jp", (0.1, 0.2, 0.3), "PSM1"), ("move_jp", (0.2, -0.2, 100.0), "PSM3"),
    ("servo_jp", (0.1, 0.2, 100.5), "PSM1"), ("servo_jp", (0.1,), "PSM1"), ("servo_jp", (math.nan,) * 3, "PSM1"),
    ("set_reference_arm", (), "PSM1"), ("set_reference_arm", (), "ECM"), ("set_reference_arm", (), ""),
    ("local/servo_cp", (0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8), "PSM2"), ("local/servo_cp", (0.0,) * 7, "ECM"),
    ("local/servo_cp", (0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8), "ECM"), ("local/servo_cp", (1.0,), "ECM"),
)
Pair = tuple[Callable[[], object], Callable[[], object]]


class CartPlay:
    """One cart, and what happens to it."""

    def __init__(self, kind: str) -> None:
        self.chance, self.trace, self.now_ns, self.log = Random(kind), Trace(), 1_000 * MS, list[str]()
        self.cart, self.kind = cart_of(kind), kind
        count = len(self.cart.arms)
        self.state, self.setpoint = FakeMemory(SUJ_STATE, setups=count), FakeMemory(SUJ_SETPOINT)
        self.io, self.link = FakeCartIo(self.log), FakePotLink(self.cart)
        self.pressed, self.powered = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
        self.tips = [FakeRing() for _ in self.cart.arms]
        self.alive = [True] * count
        for place, ring in enumerate(self.tips):
            ring.write(self.now_ns, matrix_from_pose(np.array((0.1, 0.2, 0.1 * place, 0.0, 0.0, 0.6, 0.8))))
        if self.cart.arms[0].primary:
            self.pots = [Potentiometers(arm, (1.0, 1.0)) for arm in self.cart.arms if arm.joints]
            for place in range(count if kind != FIXED else 0):
                self.stand(place, np.array((0.1, 0.2, -0.3)))
        self.start()
        self.mishaps = Mishaps(self.chance, self.all_mishaps(), often=0.015 if kind == CLASSIC else 0.05,
                               longest=60 if kind == CLASSIC else 12)

    def start(self) -> None:
        """A process on the record of the one before."""
        reports, field = LoggedReports(self.log), self.state.field
        setups, source = Setups(self.cart, field), None
        self.classic: Classic | None = None
        if self.kind == CLASSIC:
            self.io_stall = ""
            io = self.io.document
            place = RecordPlace(1, io.robots[1], slice(2, 6), slice(6, 6))
            board = InterfaceBoard(io, place, self.io, self.io,  # type: ignore[arg-type]
                                   io_stall=lambda since_ns: self.io_stall)
            self.classic = source = Classic(self.cart, setups, board, reports, field, self.setpoint.field,
                                            Multiplexer(2, 4 * MS))
        tips = [CarriedTip(arm.carries, Input(ring, SETUP_LATE_S))  # type: ignore[arg-type]
                for arm, ring in zip(self.cart.arms, self.tips, strict=True)]
        made = source or (Si(self.cart, setups, self.link, reports, field,  # type: ignore[arg-type]
                             lambda now_ns: (self.pressed, self.powered), self.let_go) if self.kind == SI else None)
        self.joints = SetupJoints(self.cart, setups, made, SetupContext(
            field, reports, tips, LoggedCell(self.log), self.io.on_behalf))

    def let_go(self, place: int, on: bool) -> None:
        """Of Si brakes, those of a step as one."""
        self.io.lets_through("setup_brake", (float(on),), self.cart.arms[place].carries)
        line = f"brake of {self.cart.arms[place].name}: {on}"
        if line not in self.log:
            self.log.append(line)

    def stand(self, place: int, joints: Any, apart: float = 0.0) -> None:
        """Hands put an arm there; `apart`: what the second potentiometers of joint 2 show beside it."""
        first, second = self.pots[place].volts(joints)
        second[1] += apart / self.cart.arms[place].secondary[1][0]
        plug = self.cart.arms[place].plug - 1
        self.io.volts[plug, :3], self.io.volts[plug, 6:9], self.io.volts[plug, 12:] = first, second, (1, 2, 3 + plug, 4)
        self.link.counts[place] = first, second

    def all_mishaps(self) -> list[Pair]:
        io, link, x = self.io, self.link, self.chance.choice

        def pair(owner: Any, name: str, value: object) -> Pair:
            before = getattr(owner, name)
            return lambda: setattr(owner, name, value), lambda: setattr(owner, name, before)

        def moved(place: int, by: float, apart: float = 0.0) -> Pair:
            return (lambda: self.stand(place, np.array((0.1 + by, 0.2, -0.3)), apart),
                    lambda: self.stand(place, np.array((0.1, 0.2, -0.3))))

        def tip_of(place: int, valid: bool, turned: float) -> Pair:
            pose = matrix_from_pose(np.array((0.1, 0.2, 0.5, 0.0, 0.0, math.sin(turned), math.cos(turned))))
            return lambda: self.tips[place].write(self.now_ns, pose, valid), lambda: self.tips[place].write(
                self.now_ns, matrix_from_pose(np.array((0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8))))

        def nothing() -> None:
            """It is over by itself."""

        common: list[Pair] = [(self.start, nothing), tip_of(0, True, 0.3), tip_of(0, False, 0.3), tip_of(1, True, 0.1),
                              (lambda: self.alive.__setitem__(0, False), lambda: self.alive.__setitem__(0, True))]
        if self.kind in (SI, CLASSIC):
            common += [moved(0, 0.05), moved(1, 0.0019), moved(2, 0.002), moved(2, 0.0, math.radians(1.1)),
                       moved(3, 0.0, math.radians(2.1)), moved(1, 0.0, math.radians(0.9))]
        if self.kind == SI:
            above = [address.upper() for address in (self.cart.base_board, *(arm.board for arm in self.cart.arms))]
            boards = [self.cart.base_board, *(arm.board.upper() for arm in self.cart.arms)]
            return common + [
                *((lambda place=place: self.pressed.__setitem__(place, True),  # type: ignore[misc]
                   lambda place=place: self.pressed.__setitem__(place, False)) for place in range(4)),
                *((lambda address=address: link.silent.add(address), link.silent.clear)  # type: ignore[misc]
                  for address in boards),
                (lambda: (link.silent.add(x(boards)), link.problems.update(dict.fromkeys(above, "away"))),
                 lambda: (link.silent.clear(), link.problems.clear())),
                (lambda: link.odd.update({x(boards): x((b"no", b'{"pots": [[1], [2]]}'))}), link.odd.clear)]
        if self.kind != CLASSIC:
            return common
        return common + [
            *((lambda name=name: io.pressed.add(name), io.pressed.clear)  # type: ignore[misc]
              for name in (*BUTTONS, "motor_up", "motor_down")),
            (lambda: io.pressed.update(("motor_up", "motor_down")), io.pressed.clear),
            pair(io, "alive", False), pair(io, "valid", False), pair(io, "has_supply", False), pair(io, "deaf", True),
            (lambda: io.flags.update(bias_generation=io.flags["bias_generation"] + 1), nothing),
            (io.restart, nothing), (lambda: setattr(io, "lost", io.lost + 1), nothing),
            (lambda: io.trip(PROBLEM_FAULT), nothing), (lambda: io.trip(ARM_LOST.number), nothing),
            (lambda: setattr(io, "channel", 7), nothing), (lambda: io.flags.update(pid_enabled=0), nothing)]

    def step(self, ms: int) -> None:
        self.mishaps.step()
        requests = []
        if self.chance.random() < (0.04 if self.kind == CLASSIC else 0.2):
            name, values, text = self.chance.choice(ASKED)
            origin = Origin(len(self.trace.lines) * self.chance.randrange(2), self.io.cell.valid_from, "play")
            requests.append(FakeRequest(name, values, text, origin=origin))
        if self.kind == CLASSIC and self.joints.machine.state in ("DISABLED", "FAULT") and self.chance.random() < 0.05:
            word, origin = self.chance.choice(("home", "enable")), Origin(1, self.io.cell.valid_from, "test")
            requests.append(FakeRequest("state_command", (), word, origin=origin))
        for _ in range(ms // 2):
            self.now_ns += 2 * MS
            if self.kind == CLASSIC:
                self.io.write(self.now_ns)
        for ring, alive in zip(self.tips, self.alive, strict=True):
            ring.stamp_ns = self.now_ns if alive else ring.stamp_ns
        self.joints.step(self.now_ns, requests)
        did = [f"{r.name} {r.text}{shown(r.values)}: {', '.join(map(' '.join, r.replies))}" for r in requests]
        self.trace.look(did + self.log, self.seen())
        self.log.clear()

    def state_of(self, name: str) -> Any:
        """A field of the record."""
        return self.state.field(name)

    def seen(self) -> list[tuple[str, Any]]:
        found: list[tuple[str, Any]] = []
        for row in SUJ_STATE.fields:
            value = self.state.field(row.name)
            found += [(f"{row.name} {place}", each) for place, each in enumerate(value)] if value.ndim > 1 else [
                (row.name, value)]
        return found + [(f"setpoint {name}", self.setpoint.field(name)[..., :5] if name in ("effort", "in_effort") else
                         self.setpoint.field(name)) for name in SETPOINTS if self.kind == CLASSIC]


@pytest.mark.parametrize("kind", STEPS)
def test_setup_joints_do_in_a_long_play_what_they_did(kind: str) -> None:
    play = CartPlay(kind)
    for number in range(STEPS[kind]):
        pauses = (2, 6, 20, 30, 50, 52, 400) if number % 80 == 0 and kind == CLASSIC else (2,) if kind == CLASSIC else (
            10, 100, 500, 2500)
        play.step(play.chance.choice(pauses))
    assert len(NAMES) >= len(play.cart.arms)
    play.trace.compare(FOLDER / f"{kind.lower()}.txt")
