"""A recorded day of a kinematic PSM goes through io's step and through the arm's step, each by itself: same output.

`python -m tests.whole.test_replay --record` makes the recording anew; that is a commit of its own.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.arm.fake_io import Record, View
from tests.arm.fake_requests import FakeReports, FakeRequest
from tests.arm.test_kinematic_arm import Order, Source, kinematic_system
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.psm.psm import PsmLogic
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.kinematic import kinematic_io
from trocar.procs.io.record import IoRecord as IoRecord
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.tables import codes
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import ARM_STATE, IO_STATE, SETPOINT

FILE: Final = Path(__file__).with_name("replay.npz")
PERIOD_NS: Final = 10_000_000
AXES: Final = {"axes": 7, "drives": 7, "robots": 1, "inputs": 0, "outputs": 0}
NEVER_SAME: Final = ("write_ns",)
CLOSE: Final = 1e-9
ASKED: Final[dict[int, tuple[str, tuple[float, ...], str]]] = {
    3: ("state_command", (), "enable"), 20: ("state_command", (), "home"),
    200: ("move_jp", (0.2, -0.1, 0.15, 0.4, 0.3, -0.2), ""), 320: ("servo_jf", (0.01,) * 6, ""),
    340: ("state_command", (), "pause"), 350: ("state_command", (), "resume"),
    380: ("state_command", (), "enable"), 400: ("state_command", (), "disable"),
}
TO_IO: Final = {412: ("power_on", ()), 420: ("pid_enable", (0.0,)), 425: ("power_off", ())}  # of a person
FAULT_AT: Final = 365
CYCLES: Final = 440


def ns(cycle: int) -> int:
    return 5_000_000_000 + cycle * PERIOD_NS


class IoAlone:
    """io on the setpoints it is given."""

    def __init__(self, setpoint: Record) -> None:
        self.memory, self.cycle = Record(IO_STATE, **AXES), 0
        self.source = Source(setpoint)
        io, record = kinematic_system().io("io"), IoRecord(self.memory.field)
        self.core = kinematic_io(IoContext(io, lambda: ns(self.cycle), record, [self.source]))

    def step(self, cycle: int) -> None:
        self.cycle = cycle
        name, values = TO_IO.get(cycle, ("", ()))
        if cycle == FAULT_AT:
            self.core.reports.trip(codes.NOT_FINITE, 0)
        self.core.cycle([Order(1, name, values, "PSM1", [])] if name else [])
        self.source.stamp_ns = ns(cycle)


class ArmAlone:
    """The arm on io's records that it is given."""

    def __init__(self, io: Record) -> None:
        self.setpoint, self.state = Record(SETPOINT), Record(ARM_STATE)
        self.arm = PsmLogic(kinematic_system().arms[0], ArmContext(
            io.field, 0, 0, {}, False, self, self.state.field, self.setpoint.field, FakeReports(),
            lambda number: FaultReport(codes.IO_FAULT, f"fault number {number}")))

    def send(self, name: str, values: Any, text: str) -> int:
        raise AssertionError(f"a kinematic robot needs no order, not {name}")

    def on_behalf(self, origin: object) -> None: ...

    def poll(self) -> list[Any]:
        return []

    def step(self, cycle: int) -> None:
        asked = ASKED.get(cycle)
        self.arm.step(ns(cycle), ns(cycle), 1, [FakeRequest(*asked)] if asked else [])


def names(topic: Any, **dims: int) -> list[str]:
    return [name for name in schema_of(topic, dims).dtype.names[2:] if name not in NEVER_SAME]


def taken(view: View, fields: list[str]) -> dict[str, NDArray[Any]]:
    return {name: view[name].copy() for name in fields}


def record() -> None:
    """Both together, from nothing to a person who switches off at io."""
    io_memory, rows = Record(IO_STATE, **AXES), []
    arm = ArmAlone(io_memory)
    io = IoAlone(arm.setpoint)
    for cycle in range(CYCLES):
        io.step(cycle)
        shown = taken(io.memory, names(IO_STATE, **AXES))
        give(io_memory, shown)
        arm.step(cycle)
        rows.append({f"io/{name}": value for name, value in shown.items()}
                    | {f"setpoint/{name}": value for name, value in taken(arm.setpoint, names(SETPOINT)).items()}
                    | {"sub_state": arm.state["sub_state"].copy()})
    np.savez_compressed(FILE, **{name: np.array([row[name] for row in rows]) for name in rows[0]})


def give(memory: Record, shown: dict[str, NDArray[Any]]) -> None:
    for name, value in shown.items():
        memory.set(name, value)


@pytest.fixture(scope="module")
def recorded() -> dict[str, NDArray[Any]]:
    with np.load(FILE) as file:
        return {name: file[name] for name in file.files}


def at(recorded: dict[str, NDArray[Any]], kind: str, cycle: int) -> dict[str, NDArray[Any]]:
    return {name.partition("/")[2]: rows[cycle] for name, rows in recorded.items() if name.startswith(f"{kind}/")}


def same(view: View, expected: dict[str, NDArray[Any]], cycle: int) -> None:
    for name, value in expected.items():
        found = view[name]
        if value.dtype.kind == "f":
            assert np.allclose(found, value, rtol=0.0, atol=CLOSE, equal_nan=True), (cycle, name, found, value)
        else:
            assert np.array_equal(found, value), (cycle, name, found, value)


def test_io_gives_what_was_recorded(recorded: dict[str, NDArray[Any]]) -> None:
    setpoint = Record(SETPOINT)
    io = IoAlone(setpoint)
    for cycle in range(CYCLES):
        io.step(cycle)
        same(io.memory, at(recorded, "io", cycle), cycle)
        give(setpoint, at(recorded, "setpoint", cycle))


def test_the_arm_gives_what_was_recorded(recorded: dict[str, NDArray[Any]]) -> None:
    memory = Record(IO_STATE, **AXES)
    arm = ArmAlone(memory)
    for cycle in range(CYCLES):
        give(memory, at(recorded, "io", cycle))
        arm.step(cycle)
        same(arm.setpoint, at(recorded, "setpoint", cycle), cycle)
        assert arm.state["sub_state"] == recorded["sub_state"][cycle], cycle


def test_the_recording_is_worth_it(recorded: dict[str, NDArray[Any]]) -> None:
    states = {state.decode() for state in recorded["sub_state"].tolist()}
    assert {"DISABLED", "ENABLED", "HOMING", "HOMED", "PAUSED", "FAULT"} <= states
    assert len(np.unique(recorded["setpoint/desired_generation"])) > 10 and recorded["io/desired_void"].any()
    assert recorded["io/effort_mode"].any() and np.ptp(recorded["io/position"], axis=0).min() > 0.01


if __name__ == "__main__" and sys.argv[1:] == ["--record"]:
    record()
