"""Potentiometers and grippers calibrated by hand on emulated robots, and the files that come of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.tools.commission.harness import RigBench
from trocar.procs.config import PROJECT_CONFIGS, check_file, load_system
from trocar.procs.config.read.source import read_source
from trocar.tools.commission import calibrate, io_file
from trocar.tools.commission.finding import Outcome
from trocar.tools.commission.picture import SIDES, picture
from trocar.tools.converters import to_json
from trocar.tools.new_arm.verb import new_arm
from trocar.tools.output.errors import Problem

IO_FILE = PROJECT_CONFIGS / "io" / "PSM1-demo.yaml"


def _pots(path: Path) -> list[dict[str, float]]:
    source, _ = read_source(path)
    assert source is not None
    return [actuator["potentiometer"]["voltage_to_position"] for actuator in source.data["robots"][0]["actuators"]]


def test_offsets_that_are_wrong_are_found_and_written_into_a_new_file(tmp_path: Path) -> None:
    wrong = [0.05, 0.0, 0.004, -0.1, 0.0, 0.0, 0.0]
    bench = RigBench("demo.yaml", sets=[f"emulation.robots.PSM1.pot_offset={wrong}"])
    before = IO_FILE.read_bytes()
    outcome = calibrate.run(bench, tmp_path)
    assert outcome.problems == []
    assert IO_FILE.read_bytes() == before
    made = tmp_path / "PSM1-demo-rehearsed.json"
    assert outcome.files == [made]
    assert [problem.key for problem in check_file(made).problems] == ["_rehearsed"]
    was, now = _pots(IO_FILE), _pots(made)
    assert [row["scale"] for row in now] == pytest.approx([row["scale"] for row in was], rel=5e-3)
    change = np.array([b["offset"] - a["offset"] for a, b in zip(was, now, strict=True)])
    assert change == pytest.approx([-w for w in wrong], abs=0.01)


def test_axes_that_cannot_be_held_at_zero_keep_their_offsets(tmp_path: Path) -> None:
    bench = RigBench("demo.yaml")
    bench.person.chosen = lambda question, axes: (3, 4, 5, 6)
    calibrate.run(bench, tmp_path)
    was, now = _pots(IO_FILE), _pots(tmp_path / "PSM1-demo-rehearsed.json")
    assert [row["offset"] for row in now[:3]] == [row["offset"] for row in was[:3]]


@pytest.mark.parametrize(("breaks", "says"), [
    (lambda b: b.faults.kill_pot("PSM1", 2, True), "PSM1 axis 2 (insertion), board 6: the "
     "voltage of its potentiometer did not change"),
    (lambda b: b.faults.scale_encoder("PSM1", 1, 1.5), "PSM1 axis 1 (pitch), board 6: scale -0.75"),
    (lambda b: b.faults.scale_encoder("PSM1", 0, -1.0), "in the file -0.762; allowed: the file's within 25 %"),
])
def test_what_calibrating_would_only_hide_stops_it_and_writes_nothing(breaks, says: str, tmp_path: Path) -> None:
    bench = RigBench("demo.yaml")
    breaks(bench)
    outcome = calibrate.run(bench, tmp_path)
    assert says in str(outcome.problems[0])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_master_is_calibrated_in_the_space_of_its_potentiometers_and_so_is_its_gripper(tmp_path: Path) -> None:
    bench = RigBench("demo-mtm.yaml")
    bench.subjects = tuple(subject for subject in bench.subjects if subject.name.startswith("MTML"))
    outcome = calibrate.run(bench, tmp_path)
    assert outcome.problems == []
    for name, count in (("MTML-demo", 6), ("MTML-gripper-demo", 1)):
        was, now = _pots(PROJECT_CONFIGS / "io" / f"{name}.yaml"), _pots(tmp_path / f"{name}-rehearsed.json")
        for axis in range(count):
            assert now[axis]["scale"] == pytest.approx(was[axis]["scale"], rel=0.02)
            assert now[axis]["offset"] == pytest.approx(was[axis]["offset"], rel=0.02, abs=0.02)


def test_a_gripper_reads_0_closed_and_60_degrees_open() -> None:
    line = calibrate.gripper_line(1.0, 3.5)
    assert line is not None
    assert line.scale * 1.0 + line.offset == pytest.approx(0.0)
    assert line.scale * 3.5 + line.offset == pytest.approx(np.pi / 3)
    assert calibrate.gripper_line(1.0, 1.1) is None


@pytest.fixture
def site_file(tmp_path: Path) -> Path:
    """An IO file of a site, in JSON."""
    source, _ = read_source(IO_FILE)
    assert source is not None
    path = tmp_path / "sawRobotIO1394-PSM1-demo.json"
    path.write_text(to_json(source.data))
    return path


def test_a_sites_own_file_is_changed_only_when_asked_and_its_content_is_kept(site_file: Path) -> None:
    before = site_file.read_text()
    saved = io_file.save(site_file, {"PSM1": io_file.line_of(1, -0.51, 1.13)}, site_file.parent, write=True)
    assert (site_file.parent / f"{site_file.name}.bak1").read_text() == before
    assert [line for line in saved.diff.splitlines() if line[:1] == "+"][1:] == [
        '+                            "scale": -0.51,', '+                            "offset": 1.13']
    old, new = json.loads(before), json.loads(site_file.read_text())
    new["robots"][0]["actuators"][1]["potentiometer"]["voltage_to_position"] = {"scale": -0.5, "offset": 1.125}
    assert new == old  # nothing else has changed


def test_a_file_that_would_lose_its_comments_is_not_written_over(tmp_path: Path) -> None:
    with pytest.raises(Problem, match="is no JSON and would lose its comments"):
        io_file.save(IO_FILE, {"PSM1": io_file.line_of(1, -0.51, 1.13)}, tmp_path, write=True)


def test_values_that_are_none_are_not_written(site_file: Path) -> None:
    before = site_file.read_text()
    with pytest.raises(Problem, match=r"PSM1 actuators\.1\..*scale: nan cannot be written"):
        io_file.save(site_file, {"PSM1": io_file.line_of(1, float("nan"), 0.0)}, site_file.parent, write=True)
    assert site_file.read_text() == before
    assert [path.name for path in site_file.parent.iterdir()] == [site_file.name]


def test_values_of_a_robot_that_the_file_no_longer_has_are_not_dropped(site_file: Path) -> None:
    with pytest.raises(Problem, match="robot PSM9 is missing"):
        io_file.save(site_file, {"PSM9": io_file.line_of(1, -0.51, 1.13)}, site_file.parent, write=True)


def test_a_rehearsal_leaves_calibrated_files_of_the_robot_alone(site_file: Path) -> None:
    values = {"PSM1": io_file.line_of(1, -0.51, 1.13)}
    real = io_file.save(site_file, values, site_file.parent, write=False).path
    before = real.read_bytes()
    rehearsed = io_file.save(site_file, {"PSM1": io_file.line_of(1, -0.6, 1.0)}, site_file.parent, write=False,
                             rehearsed=True)
    assert real.read_bytes() == before and rehearsed.path != real and "rehearsed" in rehearsed.path.name


def test_real_boards_refuse_rehearsed_files_under_any_name(tmp_path: Path) -> None:
    new_arm(name="PSM1", generation="Si", serial="23456", to=tmp_path)
    system, io = tmp_path / "system-PSM1.json", tmp_path / "sawRobotIO1394-PSM1-23456.json"
    table = tmp_path / f"{io.stem}-PotentiometerLookupTable.json"
    bench = RigBench(system, sets=["calibration_mode=true"])
    rows = {"lookup": [{"from": -1.0, "to": 1.0}] * 7, "serial": "23456"}
    io_file.save_new(bench, Outcome(), table, rows, "the table of PSM1", io)
    table.with_stem(f"{table.stem}-rehearsed").replace(table)
    values: io_file.Values = {"PSM1": {("brakes", 0, "released_current"): 0.1}}
    io_file.save_all(bench, Outcome(), {str(io): values}, tmp_path, write=False)
    io.with_stem(f"{io.stem}-rehearsed").replace(io)
    assert not [problem for problem in check_file(table).problems if problem.severity == "error"]
    emulated = load_system(system, boards="emulated")
    assert emulated.system is not None and not [each for each in emulated.warnings if "_rehearsed" in str(each)]
    for sets in ((), ("calibration_mode=true",)):
        refused = load_system(system, boards="real", sets=sets)
        assert [Path(each.file) for each in refused.errors] == [io, table]
        assert all("values of the emulated robot (a rehearsal): put the arm's own file back" in each.text
                   for each in refused.errors)


def test_the_zero_position_is_shown_and_drawn_while_it_is_asked_for(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench, drawn = RigBench("demo.yaml"), list[str]()
    monkeypatch.setattr(bench.person, "report", drawn.append)
    assert calibrate.run(bench, tmp_path).problems == []
    assert bench.shown == [("PSM1", [0.0] * 6)]
    text = drawn[0].splitlines()
    assert text[0] == "The zero position of PSM1 looks like this:" and "x to the right, z up" in text[1]
    assert {"o", "x", "#"} <= set(drawn[0]) and max(map(len, text)) <= 79


def test_a_picture_has_the_directions_and_proportions_of_the_arm() -> None:
    lines = picture(np.array(((0.0, 0.0, 0.0), (0.0, 0.0, 0.4), (0.2, 0.0, 0.4))), SIDES).splitlines()
    assert lines[1] == "    o" + "·" * 9 + "x" and lines[11] == "    #"
    assert [line[4:5] for line in lines[2:11]] == ["·"] * 9
