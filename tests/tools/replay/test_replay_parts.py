"""What a replay takes of a recording: persons' commands at their instants, motions of homed arms, no real robot."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.recordings.made import written
from trocar.procs.config import PROJECT_CONFIGS, Machine, load_system
from trocar.procs.document.system import to_json
from trocar.procs.recordings.reading import RecordingReader, open_recording
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.segment import names_of
from trocar.shm.topics import ARM_STATE, AUDIT
from trocar.tools.analysis.choosing import Stretch, run_begin_ns
from trocar.tools.inspect.processes import statuses
from trocar.tools.monitor.overview import overview
from trocar.tools.output.errors import Problem
from trocar.tools.replay.asking import moves_of
from trocar.tools.replay.configuration import startable
from trocar.tools.replay.fresh import run_again
from trocar.tools.replay.live import motion_of, motions_of, real_robots
from trocar.tools.replay.recorded_commands import commands_of
from trocar.tools.replay.shown import Showing

ASKED, STATE = schema_of(AUDIT), schema_of(ARM_STATE)
PID, PERIOD = 4711, 666_667


def asked(*rows: tuple[int, str, str, int, int, int, tuple[float, ...]]) -> NDArray[Any]:
    """Audit records: stamp, command, outcome, id, pid, pid of the person's program, values."""
    found = np.zeros(len(rows), ASKED.dtype)
    for k, (stamp, command, outcome, number, pid, person, values) in enumerate(rows):
        found[k]["sequence"], found[k]["stamp_ns"], found[k]["id"], found[k]["pid"] = k + 1, stamp, number, pid
        found[k]["command"], found[k]["outcome"], found[k]["origin"] = command, outcome, person << 32 | 7
        found[k]["count"], found[k]["values"][: len(values)] = len(values), values
    return found


def moving(count: int, homed: slice) -> NDArray[Any]:
    rows = np.zeros(count, STATE.dtype)
    rows["sequence"], rows["stamp_ns"] = np.arange(count) + 1, np.arange(count) * PERIOD + 1
    rows["state"][homed], rows["is_homed"][homed], rows["count"] = b"ENABLED", True, 6
    rows["setpoint_position"][:, 0] = np.arange(count)
    return rows


@pytest.fixture
def recording(tmp_path: Path) -> Any:
    rows = asked(
        (100, "state_command", "accepted", 1, PID, PID, ()), (5_000, "state_command", "done", 1, PID, PID, ()),
        (9_000, "move_jp", "accepted", 2, PID, PID, (0.1, 0.2)), (9_001, "set_speed", "done", 3, PID, PID, (1.0,)),
        (9_002, "servo_jp", "done", 9, 99, PID, (0.3,)), (9_500, "move_jp", "refused", 4, PID, PID, (9.0,)),
        (20_000, "servo_jp", "done", 5, PID, PID, (0.5,)), (30_000, "power_on", "done", 1, 0, PID, ()))
    path = tmp_path / "one.mcap"
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "audit"): (ASKED, rows), ("PSM1", "state"): (STATE, moving(50, slice(10, 40)))})
    with open_recording(path) as found:
        yield found


def test_commands_of_persons_stand_at_the_instants_at_which_they_were_taken(recording: RecordingReader) -> None:
    found = commands_of(recording)
    assert [(each.instant_ns, each.name, each.values) for each in found] == [
        (100, "state_command", ()), (9_000, "move_jp", (0.1, 0.2)), (9_000, "set_speed", (1.0,)),
        (9_500, "move_jp", (9.0,)), (20_000, "servo_jp", (0.5,))], "not what 99 passed on, nor what an arm wished of io"


HOMED_NS = 10 * PERIOD + 1


def test_only_moves_of_the_homed_stretch_are_asked_for_again(tmp_path: Path) -> None:
    others = ("emulate_hand", "set_tool_type", "set_base_frame", "free", "state_command", "servo_jf",
              "trajectory_j/set_ratio", "use_gravity_compensation")
    rows = asked((100, "move_jp", "accepted", 1, PID, PID, (0.9,)),
                 (HOMED_NS, "move_jr", "accepted", 2, PID, PID, (0.1,)),
                 *((HOMED_NS + 100 * k, name, "done", 2 + k, PID, PID, ()) for k, name in enumerate(others, 1)),
                 (HOMED_NS + 5000, "move_cp", "refused", 20, PID, PID, ()),
                 (HOMED_NS + 6000, "jaw/move_jp", "accepted", 21, PID, PID, (0.3,)),
                 (HOMED_NS + 7000, "hold", "done", 22, PID, PID, ()),
                 (45 * PERIOD, "move_jp", "accepted", 23, PID, PID, (0.7,)))
    with (tmp_path / "asked.mcap").open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "audit"): (ASKED, rows), ("PSM1", "state"): (STATE, moving(50, slice(10, 40)))})
    with open_recording(tmp_path / "asked.mcap") as found:
        moves = moves_of(found, [motion_of(found, "PSM1", Stretch())])
        assert [each.name for each in moves.commands] == ["move_jr", "jaw/move_jp", "hold"]
        assert {text for text in moves.left_out if "outside" in text} == {
            "left out: 2 commands to PSM1 outside the time in which all arms are homed"}
        assert all(any(f" {name} to PSM1, which is not a move" in text for text in moves.left_out) for name in others)
        with pytest.raises(Problem, match="there is no move of PSM1 while homed"):
            moves_of(found, [motion_of(found, "PSM1", Stretch(20 * PERIOD))])


def test_a_motion_is_what_an_arm_did_while_it_was_homed(recording: RecordingReader) -> None:
    motion = motion_of(recording, "PSM1", Stretch())
    assert motion.setpoint.shape == (30, 6) and motion.jaw is None and motion.setpoint[0, 0] == 10
    between = motion.at(np.array([motion.stamp_ns[3] + PERIOD / 2]), motion.setpoint)
    assert between[0, 0] == pytest.approx(13.5)
    for arm, part, said in (("PSM1", Stretch(41 * PERIOD), "not homed"), ("PSM2", Stretch(), "has no PSM2/state")):
        with pytest.raises(Problem, match=said):
            motion_of(recording, arm, part)


def test_arms_that_were_recorded_without_being_homed_are_left_out(recording: RecordingReader, tmp_path: Path) -> None:
    none = np.zeros(0, STATE.dtype)
    with (tmp_path / "some.mcap").open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "state"): (STATE, moving(50, slice(10, 40))), ("PSM2", "state"): (STATE, none),
                         ("ECM", "state"): (STATE, moving(20, slice(0, 0)))})
    with open_recording(tmp_path / "some.mcap") as found:
        assert "PSM2/state" in found.record_topics, "its channel is there"
        motions, left_out = motions_of(found, ["PSM1", "PSM2", "ECM", "MTMR"], Stretch())
    assert [motion.arm for motion in motions] == ["PSM1"] and list(left_out) == ["PSM2", "ECM", "MTMR"]
    assert "not homed" in left_out["ECM"] and "has no PSM2/state" in left_out["PSM2"]


def test_setpoints_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    rows = moving(20, slice(0, 20))
    rows["setpoint_position"][5, 2] = np.nan
    with (tmp_path / "nan.mcap").open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "state"): (STATE, rows)})
    with open_recording(tmp_path / "nan.mcap") as found, pytest.raises(Problem, match="not finite"):
        motion_of(found, "PSM1", Stretch())


def test_real_robots_are_told_from_emulated_and_kinematic_ones() -> None:
    for file, boards, arms, real in (("demo", "emulated", ["PSM1"], []), ("kinematic", "", ["PSM1"], [])):
        loaded = load_system(PROJECT_CONFIGS / "systems" / f"{file}.yaml", name="x", boards=boards or None,
                             machine=Machine(lambda bus: "127.1.2.3"))
        assert loaded.system is not None and real_robots(loaded.system, arms) == real
    loaded = load_system(PROJECT_CONFIGS / "systems/demo.yaml", name="x", boards="emulated",
                         machine=Machine(lambda bus: "127.1.2.3"))
    assert loaded.system is not None
    wired = dataclasses.replace(loaded.system, emulation=None, clock="lockstep")
    assert real_robots(wired, ["PSM1"]) == ["PSM1"]
    with pytest.raises(Problem, match="not emulated"):
        startable(wired)
    (io,) = loaded.system.ios
    bridged = dataclasses.replace(loaded.system, ios=(dataclasses.replace(io, port="udpfw:127.1.2.3"),))
    assert b"udpfw:127.1.2.3" in startable(bridged)[0], "emulated boards that could do without FireWire"
    with pytest.raises(Problem, match="real time"):
        startable(dataclasses.replace(loaded.system, clock="wall"))


def test_a_recording_without_a_configuration_is_not_started(recording: RecordingReader, tmp_path: Path) -> None:
    with pytest.raises(Problem, match="recorded by another version"):
        run_again(recording, tmp_path / "again.mcap", "nobody", lambda text, fraction: None)
    assert not (tmp_path / "again.mcap").exists()


def test_what_a_new_run_lacks_is_said_before_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    loaded = load_system(PROJECT_CONFIGS / "systems" / "demo.yaml", boards="emulated")
    assert loaded.system is not None
    path = tmp_path / "paced.mcap"
    rows = asked((100, "servo_jp", "done", 1, PID, PID, (0.1,)))
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "audit"): (ASKED, rows), ("PSM1", "state"): (STATE, moving(5, slice(0, 5)))},
                document=to_json(dataclasses.replace(loaded.system, clock="paced")))
    with open_recording(path) as recording:
        recording.metadata["trocar"]["clock"] = "paced"
        with pytest.raises(Problem, match="no records of simulated time"):
            run_again(recording, tmp_path / "again.mcap", "nobody", lambda text, fraction: None)
    assert "the new run will differ" in capsys.readouterr().err


@pytest.mark.parametrize(("extents", "begin"), [
    ({"IO1/state": (100, 190), "PSM1/state": (101, 191)}, 100),
    ({"IO1/gains": (1, 1), "gui/state": (50, 189), "IO1/state": (100, 190)}, 100),  # kept in rings, from before
    ({"PSM2/setpoint": (20, 70), "IO1/state": (100, 190)}, 100),  # stopped long before
    ({"PSM2/state": (100, 140), "IO1/state": (110, 190), "PSM1/state": (150, 190)}, 100),
    ({"IO1/gains": (1, 2), "gui/state": (50, 189)}, 50), ({"IO1/gains": (1, 2)}, 1), ({}, 0)])
def test_a_run_begins_with_what_is_not_only_kept_in_a_ring(extents: dict[str, tuple[int, int]], begin: int) -> None:
    rates = {"gui/state": 1.0, "IO1/gains": 0.0}
    in_ns = {name: (first * 10**9, last * 10**9) for name, (first, last) in extents.items()}
    assert run_begin_ns(in_ns, {name: rates.get(name, 1500.0) for name in extents}) == begin * 10**9


@pytest.mark.slow
def test_records_are_shown_with_the_times_between_them(recording: RecordingReader) -> None:
    name = f"t{os.getpid()}shown"
    recording.metadata["trocar"]["clock"] = "paced"
    with Showing(name, recording, ["PSM1/state", "PSM1/audit"], Stretch()) as showing:
        assert showing.play(100.0, lambda text, fraction: None) == 58
        stamps = np.array([topic.last_ns for topic in showing.topics])
        assert (stamps > 0).all() and len(names_of(name)) == 5
        assert [row.problem for row in statuses(name)] == ["", ""], "a replay lacks nothing"
        assert overview(name).clock == "paced, as recorded"
    assert not names_of(name)
    with pytest.raises(Problem, match="nothing to show"):
        Showing(name, recording, ["PSM1/state"], Stretch(1 << 60))
    assert not names_of(name)
