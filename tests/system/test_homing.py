"""Real arms' own files on emulated boards: power, encoders, homing, in the order and the time they should take.

tests/arm show the same on a stepped clock, test_robot.py and test_masters.py that such files home as processes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.system.robot import Robot
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.soak]

COMMON = ("POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED")
ROLL = ("CALIBRATING_ROLL", "RESETTING_ROLL_ENCODER")
TO_ZERO, STAY = True, False

# system file, arm, states on the way to HOMED, homing goal, tolerance of every joint, most s from power-on to HOMED
ARMS = (
    ("jhu-dVRK/system-PSM1.json", "PSM1", (*COMMON, "HOMING"), STAY, (0.0524,) * 7, 8.0),
    ("jhu-daVinci/system-ECM.json", "ECM", (*COMMON, "HOMING"), STAY, (0.0524,) * 4, 10.0),
    ("jhu-daVinci-Si/system-PSM1.json", "PSM1", (*COMMON, "HOMING"), STAY, (0.0524,) * 7, 10.0),
    ("jhu-daVinci-Si/system-ECM.json", "ECM", (*COMMON, "HOMING"), STAY, (0.0524,) * 4, 10.0),
    ("jhu-dVRK/system-MTMR.json", "MTMR", (*COMMON, *ROLL, "HOMING"), TO_ZERO, (0.0699,) * 6 + (0.1048,), 20.0),
)


def sequence(robot: Robot, arm: str) -> Iterator[tuple[str, int]]:
    """Sub-states an arm has been in, with the time it entered each, ns."""
    reader = directory.reader(robot.name, arm, "events")
    before = ""
    for row in reader.last(1000):
        state = row["sub_state"].decode()
        if row["event"] == b"operating_state" and state != before:
            before = state
            yield state, int(row["stamp_ns"])
    reader.close()


@pytest.mark.parametrize(("file", "arm", "states", "zero", "tolerance", "most_s"), ARMS)
def test_an_arm_homes_from_its_own_files(
    robot: Robot, data: Callable[[str], Path], file: str, arm: str, states: tuple[str, ...], zero: bool,
    tolerance: tuple[float, ...], most_s: float, record_property: Callable[[str, object], None]
) -> None:
    robot.up(data(f"dvrk-site/{file}"), "--boards", "emulated", "--path", str(data("dvrk-share")),
             "--set", "clock=lockstep")
    robot.trocar("power-on", arm, timeout=300.0)
    robot.trocar("home", arm, timeout=300.0)
    seen = list(sequence(robot, arm))
    names = [state for state, _ in seen]
    begin = names.index("POWERING")
    assert tuple(names[begin:]) == (*states, "HOMED")
    took = [(after - before) * 1e-9 for (_, before), (_, after) in zip(seen[begin:], seen[begin + 1 :], strict=False)]
    state = directory.reader(robot.name, arm, "state")
    assert state.newest()
    n = len(tolerance)
    error = np.abs(state.field("position")[:n] - (0.0 if zero else state.field("setpoint_position")[:n]))
    times = dict(zip(names[begin:], (round(t, 3) for t in took), strict=False))
    record_property("homing", json.dumps({"file": file, "times_s": times, "errors": error.round(5).tolist()}))
    print(file, times, "errors", error.round(4).tolist())
    assert (error < tolerance).all(), error
    assert sum(took) - times["ENABLED"] < most_s
    assert bool(state.field("is_homed"))
    state.close()
