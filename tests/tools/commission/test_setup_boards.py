"""Boards of Classic setup joints in the stages of all boards: read, power, stop; what does not switch off is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests import stock
from tests.tools.commission.harness import RigBench
from trocar.procs.config.read.source import read_source
from trocar.tools.commission import bench as running
from trocar.tools.commission import brakes, currents, power, read, stop
from trocar.tools.commission.bench import CommandOutcome, RunningBench
from trocar.tools.commission.window import Window
from trocar.tools.output.errors import Problem


def of_the_site(*sets: str) -> RigBench:
    return RigBench(stock.find("dvrk-site/jhu-daVinci/system-SUJ.json"), sets, search=[stock.find("dvrk-share")])


@pytest.fixture
def bench() -> RigBench:
    made = of_the_site()
    made.harness.run(0.5)
    assert [subject.name for subject in made.setups] == ["SUJ"] and made.subjects == ()
    return made


@pytest.mark.slow
def test_boards_of_setup_joints_pass_and_are_off_afterwards(bench: RigBench) -> None:
    seen = read.run(bench)
    assert seen.problems == [] and {"IO1", "SUJ"} <= set(seen.figures) and len(seen.figures["inputs"]) == 6
    assert not any("never changed" in note for note in seen.notes)
    assert power.run(bench).problems == [] and bench.person.confirmed == ["SUJ"]
    stopped = stop.run(bench)
    assert stopped.figures["IO1 stop_s"]["SUJ"] <= stop.STOP_S
    assert "came on by itself" in str(stopped.problems[0])  # nothing but io runs here: `suj` would prevent it
    assert not bench.harness.record.amp_on.any() and not bench.harness.record.powered.any()


def test_an_emergency_stop_that_is_not_wired_to_the_setup_joints_stops_the_stage(
        bench: RigBench, monkeypatch: pytest.MonkeyPatch) -> None:
    dangers: list[str] = []
    monkeypatch.setattr(bench.person, "confirm", lambda danger, word: dangers.append(danger))
    monkeypatch.setattr(bench.faults, "stop", lambda pressed: None)
    outcome = stop.run(bench)
    assert "SUJ axis 0 (brakes of plug 1), board" in str(outcome.problems[0])
    assert "its amplifier is still on after the emergency stop" in str(outcome.problems[0])
    assert "Press no clutch of the setup joints, and no button of their column." in dangers[0]
    assert not bench.harness.record.amp_on.any()


def test_the_stage_of_brakes_says_that_it_does_not_test_setup_joints(bench: RigBench, tmp_path: Path) -> None:
    (note,) = brakes.run(bench, tmp_path).notes
    assert note.startswith("SUJ: ") and "are not tested" in note
    assert bench.person.confirmed == []


def test_current_offsets_of_setup_joints_are_found_and_written(tmp_path: Path) -> None:
    command, measured = [0.031, -0.012, 0.02, 0.0], [-0.007, 0.04, 0.001, -0.03]
    hidden = {"command_current": command, "measured_current": measured}
    bench = of_the_site(*(f"emulation.robots.SUJ.{key}={values}" for key, values in hidden.items()))
    assert currents.run(bench, tmp_path).problems == [] and bench.person.confirmed == ["SUJ"]
    assert not bench.harness.record.amp_on.any() and not bench.harness.record.powered.any()
    (file,) = tmp_path.iterdir()
    was, now = (read_source(path)[0] for path in (Path(bench.setups[0].robot.source), file))
    assert was is not None and now is not None
    (old,), (new,) = ([each for each in source.data["robots"] if each["name"] == "SUJ"] for source in (was, now))
    for k, (before, after) in enumerate(zip(old["actuators"], new["actuators"], strict=True)):
        before, after = before["drive"], after["drive"]
        scale = before["current_to_bits"]["scale"]
        found_c = (before["current_to_bits"]["offset"] - after["current_to_bits"]["offset"]) / scale
        found_a = before["bits_to_current"]["offset"] - after["bits_to_current"]["offset"]
        assert (found_a, found_c) == pytest.approx((measured[k], command[k]), abs=1e-3)


def test_a_clutch_pressed_while_current_offsets_are_measured_writes_nothing(
        bench: RigBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sample = bench.sample

    def pressed(io: str, seconds: float) -> Window:
        window = sample(io, seconds)
        window.fields["current_request"] = window.fields["current_request"] + 2.2 * window.fields["amp_on"]
        return window

    monkeypatch.setattr(bench, "sample", pressed)
    assert "2.200 A were requested" in str(currents.run(bench, tmp_path).problems[0])
    assert list(tmp_path.iterdir()) == [] and not bench.harness.record.amp_on.any()


def test_a_supply_of_the_setup_joints_that_does_not_come_up_stops_the_stage(bench: RigBench) -> None:
    bench.faults.stop(True)
    assert "SUJ, board" in str(power.run(bench).problems[0])


def test_brakes_of_setup_joints_that_keep_their_amplifiers_are_named(
        bench: RigBench, monkeypatch: pytest.MonkeyPatch) -> None:
    (subject,) = bench.setups
    ordered: list[str] = []

    def asked(self: RunningBench, io: str, command: str, *_: object) -> tuple[CommandOutcome, object]:
        ordered.append(f"{io} {command}")
        return CommandOutcome("done", ""), None

    monkeypatch.setattr(running, "bring_all", lambda *_: None)
    monkeypatch.setattr(RunningBench, "asked", asked)
    monkeypatch.setattr(RunningBench, "sample", lambda self, io, seconds: window)
    live = RunningBench.__new__(RunningBench)
    live.system = "x"
    window = bench.sample("IO1", 0.1)
    live.disable(subject)
    window.fields["amp_on"] = np.ones_like(window.fields["amp_on"])
    with pytest.raises(Problem, match=r"SUJ, board.* amplifiers are still on; press the emergency stop"):
        live.disable(subject)
    assert ordered == ["IO1 power_off"] * 2
