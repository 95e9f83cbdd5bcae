"""`trocar new-arm`: files of an arm that has never run with the dVRK."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.host.hosted import COARSE, HashedArm
from tests.tools.commission.harness import RigBench
from trocar.procs.config import check_file, load_system
from trocar.procs.config.read.source import read_source
from trocar.procs.host.host import Host
from trocar.tools.commission import currents
from trocar.tools.new_arm.arm_numbers import ARMS, BOARDS, CLASSIC, SI
from trocar.tools.new_arm.verb import HARDWARE, new_arm
from trocar.tools.output.errors import Misuse, Problem

SERIAL = "12345"
GAINS = {"PSM": [-0.00085, -0.00056, 0.000065, -0.0015, -0.0015, -0.0015, -0.0015],
         "ECM": [0.0011, 0.0007, -0.00015, -0.0009],
         "MTM": [0.0015, 0.0015, 0.0015, -0.0015, 0.0015, 0.0015, 0.0008, 0.0]}
OFFSETS = {"PSM": [1.75, 1.13, -0.015, 3.1, 3.1, 3.1, 3.1], "ECM": [-2.2, -1.2, 0.3, 1.8],
           "MTM": [-2.5, -2.3, -2.5, 1.8, 4.0, -3.1, -1.2, 0.0]}
EVERY = [(name, generation, hardware) for name, generation in ARMS for hardware in HARDWARE[generation]]


def cal_of(folder: Path, name: str, **changes: str) -> Path:
    """A `.cal` file; `changes` replace the text of an assignment; an empty text removes it."""
    kind = ARMS[name, CLASSIC].type
    gains = list(GAINS[kind])
    if name == "MTML":
        gains[4] *= -1
    rows = {"FileType": f"[ '{kind}_CAL' ]", "serial_number": f"[ {SERIAL} ]",
            "motor.pot_input_gain": f"[ {' '.join(map(str, gains))} ]",
            "motor.pot_input_offset": f"[ {' '.join(map(str, OFFSETS[kind]))} ]"} | changes
    path = folder / f"{name}.cal"
    path.write_text("\n".join(f"{key} = {text}" for key, text in rows.items() if text), encoding="utf-8")
    return path


def make(folder: Path, name: str, generation: str = CLASSIC, hardware: str = "", **options: Any) -> dict[str, Any]:
    """The content of the IO file."""
    if generation == CLASSIC and "cal" not in options:
        options["cal"] = cal_of(folder, name)
    elif generation == SI:
        options["serial"] = SERIAL
    assert new_arm(name=name, generation=generation, boards=hardware, to=folder, **options) == 0
    found: dict[str, Any] = json.loads((folder / f"sawRobotIO1394-{name}-{SERIAL}.json").read_text(encoding="utf-8"))
    return found


def flat(data: object, at: str = "") -> Iterator[tuple[str, object]]:
    """Every value with its place."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from flat(value, f"{at}.{key}")
    elif isinstance(data, list):
        named = all(isinstance(row, dict) and "name" in row for row in data)
        rows = sorted(data, key=lambda row: str(row["name"])) if named else data
        for place, value in enumerate(rows):
            yield from flat(value, f"{at}[{place}]")
    else:
        yield at, data


@pytest.mark.parametrize(("name", "generation", "hardware"), EVERY)
def test_each_arm_starts_in_calibration_mode_and_only_lacks_calibration(
        tmp_path: Path, name: str, generation: str, hardware: str) -> None:
    make(tmp_path, name, generation, hardware)
    system = tmp_path / f"system-{name}.json"
    assert not [problem for problem in check_file(system, sets=["calibration_mode=true"]).problems
                if problem.severity == "error"]
    errors = [problem for problem in check_file(system).problems if problem.severity == "error"]
    places = ("current_to_bits.offset", "voltage_to_position", "lookup_table_file")
    assert errors and all(problem.key.endswith(places) for problem in errors)


@pytest.mark.parametrize(("file", "name", "generation"), [
    ("jhu-dVRK/sawRobotIO1394-PSM1-28007.json", "PSM1", CLASSIC),
    ("jhu-dVRK/sawRobotIO1394-MTML-22723.json", "MTML", CLASSIC),
    ("jhu-dVRK/sawRobotIO1394-MTMR-22403.json", "MTMR", CLASSIC),
    ("jhu-daVinci/sawRobotIO1394-ECM-29738.json", "ECM", CLASSIC),
    ("jhu-daVinci-Si/sawRobotIO1394-PSM1-292409.json", "PSM1", SI),
    ("jhu-daVinci-Si/sawRobotIO1394-ECM-438610.json", "ECM", SI)])
def test_an_io_file_has_the_values_of_a_site_but_for_what_the_site_calibrated(
        tmp_path: Path, data: Callable[[str], Path], file: str, name: str, generation: str) -> None:
    source, _ = read_source(data(f"dvrk-site/{file}"))
    assert source is not None
    theirs, ours = dict(flat(source.data)), dict(flat(make(tmp_path, name, generation)))
    calibrated = ("current.offset", "bits.offset", "voltage_to_position.scale", "voltage_to_position.offset",
                  "release_current", "released_current", ".distance", ".latency", "serial_number", "lookup_table_file")
    compared = [key for key in ours if not key.endswith(calibrated)]
    assert len(compared) > 90 and not [key for key in theirs if key not in ours and ".brake." not in key]
    for key in compared:
        expected = theirs[key]
        if isinstance(expected, float):
            # the generator rounds this one to nine decimals, ours is exact
            assert ours[key] == pytest.approx(expected, rel=2e-6 if "bits_to_current" in key else 1e-12), key
        else:
            assert ours[key] == expected, key


def test_potentiometers_get_the_maker_s_line_in_volts(tmp_path: Path) -> None:
    (robot,) = make(tmp_path, "PSM1")["robots"]
    assert robot["actuators"][0]["potentiometer"]["voltage_to_position"] == {"offset": 1.75, "scale": -0.77368889}


def test_boards_follow_the_ids_and_the_hardware(tmp_path: Path) -> None:
    def places(made: dict[str, Any]) -> list[tuple[int, int]]:
        (robot,) = made["robots"]
        return [(row["board_id"], row["axis_id"]) for row in (*robot["actuators"], *robot["brakes"])]

    assert places(make(tmp_path, "ECM", ids="9,3")) == [(9, 0), (9, 1), (9, 2), (9, 3), (3, 0), (3, 1), (3, 2)]
    assert places(make(tmp_path, "ECM", hardware="DQLA")) == [(4, axis) for axis in range(7)]
    buttons = {row["name"]: (row["board_id"], row["bit_id"])
               for row in make(tmp_path, "PSM2", hardware="DQLA")["digital_inputs"]}
    assert (buttons["PSM2_tool"], buttons["PSM2_adapter"]) == ((8, 23), (8, 26))
    assert set(dict.fromkeys(BOARDS.values())) == set(BOARDS.values()), "no two arms share a board"


def test_a_master_also_gets_a_gripper_that_is_marked_as_not_calibrated(tmp_path: Path) -> None:
    make(tmp_path, "MTML")
    made = json.loads((tmp_path / f"sawRobotIO1394-MTML-gripper-{SERIAL}.json").read_text(encoding="utf-8"))
    (robot,) = made["robots"]
    (actuator,) = robot["actuators"]
    assert (robot["name"], robot["type"]) == ("MTML_gripper", "io-only")
    assert (actuator["board_id"], actuator["axis_id"]) == (1, 3)
    assert actuator["potentiometer"]["voltage_to_position"] == {"offset": 0.0, "scale": 0.0}


def test_the_next_command_can_be_pasted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path / "my site", "PSM1", cal=cal_of(tmp_path, "PSM1"))
    assert f"next: trocar check '{tmp_path}/my site/system-PSM1.json'" in capsys.readouterr().out


def test_files_that_were_there_are_kept(tmp_path: Path) -> None:
    old = tmp_path / "system-PSM1.json"
    old.write_text("mine", encoding="utf-8")
    make(tmp_path, "PSM1")
    assert (tmp_path / "system-PSM1.json.bak1").read_text(encoding="utf-8") == "mine" != old.read_text(encoding="utf-8")


LIMITS = {"joint.signal_range(UPPER_LIMIT,1:7)": "[ 1.6 0.9 0.24 3 3 3 3 ]",
          "joint.signal_range(LOWER_LIMIT,1:7)": "[ -1.6 -0.9 0 -3 -3 -3 -3 ]",
          "motor.pot_limit_checks(UPPER_LIMIT,1:7)": "[ 4000 4000 3700 4096 4096 4096 4096 ]",
          "motor.pot_limit_checks(LOWER_LIMIT,1:7)": "[ 150 1500 0 0 0 0 0 ]"}


SI_RANGE = LIMITS | {"joint.signal_range(UPPER_LIMIT,1:7)": "[ 2.97 1.3 0.29 3 3 3 3 ]",
                     "joint.signal_range(LOWER_LIMIT,1:7)": "[ -2.97 -1.3 0 -3 -3 -3 -3 ]"}


@pytest.mark.parametrize(("name", "changes", "what"), [
    ("PSM1", SI_RANGE, "--generation Si"),
    ("PSM1", {"FileType": "[ 'MTM_CAL' ]"}, "MTM_CAL"), ("PSM1", {"serial_number": ""}, "serial_number"),
    ("PSM1", {"motor.pot_input_gain": "[ 1 2 ]"}, "pot_input_gain"), ("PSM1", LIMITS, "axis 1"),
    ("PSM1", {"motor.pot_input_gain": "[ 0 1 1 1 1 1 1 ]"}, "axis 0"),
    ("MTMR", {"motor.pot_input_gain": "[ 1 1 1 1 -1 1 1 0 ]"}, "MTML")])
def test_a_file_of_another_arm_or_a_damaged_one_is_refused_and_nothing_is_written(
        tmp_path: Path, name: str, changes: dict[str, str], what: str) -> None:
    with pytest.raises(Problem, match=what):
        make(tmp_path, name, cal=cal_of(tmp_path, name, **changes))
    assert [path.name for path in tmp_path.iterdir()] == [f"{name}.cal"]


@pytest.mark.parametrize("options", [
    {"name": "PSM9"}, {"name": "PSM1", "generation": "X"}, {"name": "MTML", "generation": SI},
    {"name": "PSM1", "cal": None}, {"name": "PSM1", "hardware": "dRA1"},
    {"name": "PSM1", "generation": SI, "hardware": "QLA1"},
    *({"name": "PSM1", "ids": ids} for ids in ("1", "1,1", "1,16", "1,x"))])
def test_a_choice_that_makes_no_arm_is_refused(tmp_path: Path, options: dict[str, Any]) -> None:
    with pytest.raises(Misuse):
        make(tmp_path, **({"cal": cal_of(tmp_path, "PSM1")} | options))


def test_a_serial_number_that_is_not_that_of_the_cal_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Problem, match=SERIAL):
        make(tmp_path, "PSM1", serial="54321")


@pytest.mark.slow
def test_an_emulated_arm_goes_from_its_cal_file_over_calibrated_currents_to_homed(tmp_path: Path) -> None:
    make(tmp_path, "PSM1")
    system, io = tmp_path / "system-PSM1.json", tmp_path / f"sawRobotIO1394-PSM1-{SERIAL}.json"
    assert currents.run(RigBench(system, sets=["calibration_mode=true"]), tmp_path).problems == []
    (tmp_path / f"{io.stem}-rehearsed.json").replace(io)
    loaded = load_system(system, boards="emulated", sets=COARSE)
    assert loaded.system is not None, loaded.errors
    with Host(loaded.system) as host:
        arm = HashedArm(host)
        arm.homes()
        assert arm.does("move_jp", (0.1, -0.1, 0.12, 0.0, 0.0, 0.0, 0.0)) == "done"
