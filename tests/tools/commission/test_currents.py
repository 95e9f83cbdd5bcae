"""Current offsets measured on emulated amplifiers with hidden errors, and the files that come of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.tools.commission.harness import RigBench
from trocar.procs.config import PROJECT_CONFIGS
from trocar.procs.config.read.source import read_source
from trocar.tools.commission import currents
from trocar.tools.commission.person import Declined
from trocar.tools.output.errors import Problem

FILES = {"demo.yaml": ("PSM1", "PSM1-demo", 7, 0, 0.01), "demo-ecm.yaml": ("ECM", "ECM-demo", 4, 3, 0.02)}
"""Robot, stem of its IO file, motors, brakes, hidden errors (A): axes without brakes drift if they are large."""
WITHIN_A = 3e-4  # a bit of the converter is 0.2 mA


def rig(file: str, command: list[float], measured: list[float]) -> RigBench:
    robot = FILES[file][0]
    values = {"command_current": command, "measured_current": measured, "friction": 3.0}  # else the wrist drifts
    return RigBench(file, sets=[f"emulation.robots.{robot}.{key}={value}" for key, value in values.items()])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("file", FILES)
@pytest.mark.slow
def test_hidden_errors_of_every_drive_are_found_and_written_into_a_new_file(
        file: str, seed: int, tmp_path: Path) -> None:
    name, stem, motors, brakes, hidden_a = FILES[file]
    draw = np.random.default_rng(seed)
    command, measured = (draw.uniform(-hidden_a, hidden_a, motors + brakes).tolist() for _ in range(2))
    bench = rig(file, command, measured)
    outcome = currents.run(bench, tmp_path)
    assert [str(problem) for problem in outcome.problems] == []
    assert not bench.harness.record.amp_on.any() and bench.person.confirmed == [name]
    was, _ = read_source(PROJECT_CONFIGS / "io" / f"{stem}.yaml")
    assert was is not None
    (old,), (new,) = was.data["robots"], json.loads((tmp_path / f"{stem}-rehearsed.json").read_text())["robots"]
    for k, (before, after) in enumerate(zip((*old["actuators"], *old.get("brakes", ())),
                                            (*new["actuators"], *new.get("brakes", ())),
                                            strict=True)):
        before, after = before["drive"], after["drive"]
        scale = before["current_to_bits"]["scale"]
        found_c = (before["current_to_bits"]["offset"] - after["current_to_bits"]["offset"]) / scale
        found_a = before["bits_to_current"]["offset"] - after["bits_to_current"]["offset"]
        assert (found_a, found_c) == pytest.approx((measured[k], command[k]), abs=WITHIN_A)
        assert after["current_to_bits"]["scale"] == scale and after["maximum_current"] == before["maximum_current"]


@pytest.mark.parametrize(("file", "command", "says"), [
    ("demo-ecm.yaml", [0.12, 0, 0, 0, 0, 0, 0], "ECM axis 0 (yaw), board 4: 0.120 A without a command"),
    ("demo-ecm.yaml", [0, 0, 0, 0, 0, 0, -0.12], "ECM brake 2: 0.120 A without a command"),
    ("demo.yaml", [0, -0.3, 0, 0, 0, 0, 0], "PSM1 axis 1 (pitch), board 6: it moved more than 0.35 rad")])
@pytest.mark.slow
def test_what_offsets_would_only_hide_stops_it_and_writes_nothing(
        file: str, command: list[float], says: str, tmp_path: Path) -> None:
    bench = rig(file, command, [])
    outcome = currents.run(bench, tmp_path)
    assert says in str(outcome.problems[0])
    assert list(tmp_path.iterdir()) == [] and not bench.harness.record.amp_on.any()


def test_amplifiers_stay_off_unless_the_word_is_typed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = rig("demo.yaml", [], [])

    def refuses(danger: str, word: str) -> None:
        raise Declined("no")

    monkeypatch.setattr(bench.person, "confirm", refuses)
    with pytest.raises(Declined):
        currents.run(bench, tmp_path)
    assert not bench.harness.record.powered.any()


def test_amplifiers_stay_off_if_the_motor_supply_does_not_come_up(tmp_path: Path) -> None:
    bench = rig("demo.yaml", [], [])
    bench.faults.stop(True)
    bench.harness.run(0.1)
    with pytest.raises(Problem, match="motor supply does not come up"):
        currents.run(bench, tmp_path)
    assert bench.harness.record.amps_on.tolist() == [False] and list(tmp_path.iterdir()) == []


def test_si_controllers_need_none(tmp_path: Path) -> None:
    bench = RigBench("demo-ecm-si.yaml")
    outcome = currents.run(bench, tmp_path)
    assert not outcome.problems and "need no current offsets" in outcome.notes[0] and not list(tmp_path.iterdir())


def test_offsets_follow_the_reference_s_formula() -> None:
    bench = RigBench("demo.yaml")
    (subject,) = (each for each in bench.subjects if each.arm)
    zero = np.zeros(7)
    measured, at_zero = zero.copy(), zero.copy()
    measured[2], at_zero[2] = 0.010, 0.005
    drive = subject.actuator(2)
    assert drive.current_to_bits.scale == pytest.approx(5242.88)
    made = currents.offsets(subject, measured, at_zero)
    where = ("actuators", 2, "drive")
    assert made[*where, "current_to_bits", "offset"] - drive.current_to_bits.offset == pytest.approx(26.2144)
    assert made[*where, "bits_to_current", "offset"] - drive.bits_to_current.offset == pytest.approx(-0.010)
