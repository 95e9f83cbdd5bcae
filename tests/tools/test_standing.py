"""What status says of arms and what to do first; what home waits for."""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from tests.tools.robot import ScriptedRobot, nothing_ages, robot
from trocar.procs.tables import codes
from trocar.procs.teleop.teleoperation import Start, waiting_for
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools import cli
from trocar.tools.client.bring_up import ArmBringUp
from trocar.tools.inspect import standing
from trocar.tools.inspect.processes import PastProcess, ProcessStatus
from trocar.tools.inspect.standing import Standing, first_thing, next_step

APP = cli.build()
NAMED = "instrument not named (tool_detection MANUAL): trocar send PSM1 set_tool_type NAME"
OFF = "PSM1 axis 2 (insertion), board 6: an amplifier is off although it should be on"


@pytest.fixture
def kinematic(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    nothing_ages(monkeypatch)
    monkeypatch.setattr("trocar.tools.inspect.processes._stalled", lambda row, page, simulated: False)
    with robot(world.name) as made:
        yield made


def status(kinematic: ScriptedRobot, *words: str) -> Result:
    return CliRunner().invoke(APP, ["status", *words, "--system", kinematic.name])


def test_status_ends_with_all_well(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED", homed=True)
    shown = status(kinematic)
    assert shown.exit_code == 0 and shown.stdout.splitlines()[-1] == "all well"


def test_a_fault_is_told_with_axis_board_and_hint_and_is_exit_code_1(kinematic: ScriptedRobot) -> None:
    kinematic.events.report(codes.AMPLIFIER, OFF, "PSM1", 2, board=6)
    kinematic.events.status("PSM1: FAULT", "PSM1")
    kinematic.arm.field("reason")[...] = OFF.encode()
    kinematic.show_arm(state="FAULT")
    shown = status(kinematic)
    assert shown.exit_code == 1
    assert shown.stdout.splitlines()[-1] == f"first: {OFF}; {codes.AMPLIFIER.remedy_for('PSM1')}"
    (row,) = json.loads(status(kinematic, "--json").stdout)["standings"]
    assert (row["state"], row["homed"], row["reason"]) == ("FAULT", False, OFF)
    assert (row["fault"]["code"], row["fault"]["axis"], row["fault"]["board"]) == ("amplifier", 2, 6)


def test_after_an_io_was_silent_only_what_is_left_to_do_is_named(kinematic: ScriptedRobot) -> None:
    kinematic.events.report(codes.IO_TIMEOUT, "PSM1: io does not answer", "PSM1")
    kinematic.arm.field("reason")[...] = b"PSM1: io does not answer"
    kinematic.events.operating_state("FAULT", "FAULT", False, False)
    kinematic.show_arm(state="FAULT")
    assert status(kinematic).stdout.splitlines()[-1].endswith("io does not answer; trocar home PSM1")
    kinematic.pages["IO1"].show("STARTING")
    assert status(kinematic).stdout.splitlines()[-1].endswith(
        "io does not answer; wait until IO1 is back, or trocar start IO1; then trocar home PSM1")
    kinematic.pages["IO1"].show("RUNNING")
    kinematic.supervisor.field("exit_reason")[0] = b"hung for 5.0 s, killed; where: wall.py line 16 in step"
    kinematic.supervisor.publish(monotonic_ns())
    assert status(kinematic).stdout.splitlines()[-1].endswith(
        "IO1 ended: hung for 5.0 s, killed; where: wall.py line 16 in step; trocar home PSM1")


@pytest.mark.parametrize(("after_s", "names"), [(0.5, True), (-0.01, True), (60.0, False)])
def test_a_fault_that_follows_from_the_end_of_the_boards_names_it(after_s: float, names: bool) -> None:
    code = codes.POWER_LOST
    one = Standing("PSM1", "arm", "FAULT", False, "PSM1: power went off", fault={
        "code": code.code, "hint": code.remedy, "stamp_ns": 10**12 + round(after_s * 1e9)})
    boards = dataclasses.replace(process("boards", kind="boards"), exit_reason="killed by SIGKILL",
                                 endings=(PastProcess(7, 10**12, "killed by SIGKILL"),))
    found = standing._with_what_is_left(one, process("PSM1"), [process("PSM1"), boards])
    assert first_thing([], [found]).startswith("PSM1: power went off; " + (
        "boards ended: killed by SIGKILL; trocar home PSM1" if names else code.remedy))


def test_the_file_of_another_fault_is_not_named(world: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    nothing_ages(monkeypatch)
    monkeypatch.setattr("trocar.tools.inspect.processes._stalled", lambda row, page, simulated: False)
    made = ScriptedRobot(world.name, tmp_path)
    recorder = directory.writer(world.name, "recorder", "state", "recorder")
    try:
        made.events.operating_state("FAULT", "FAULT", False, False)
        before_ns = monotonic_ns()
        for name, value in (("fault_first_ns", before_ns), ("fault_last_ns", before_ns), ("fault_path", b"/x/fault")):
            recorder.field(name)[...] = value
        made.show_arm(state="FAULT")
        recorder.publish(before_ns)
        assert "/x/fault" not in status(made).stdout
        recorder.field("fault_first_ns")[...] = before_ns - 1_000_000_000_000
        recorder.publish(before_ns)
        assert "a recording of the time before it: /x/fault" in status(made).stdout
        made.events.operating_state("FAULT", "FAULT", False, False)
        assert "a recording of the time before it: /x/fault" in status(made).stdout, "it only said it again"
        for state in ("ENABLED", "FAULT"):
            made.events.operating_state(state, state, False, False)
        assert "/x/fault" not in status(made).stdout, "this fault is another one"
    finally:
        recorder.close()
        made.close()


def test_what_a_person_has_to_do_for_an_arm_comes_first(kinematic: ScriptedRobot) -> None:
    kinematic.arm.field("reason")[...] = NAMED.encode()
    kinematic.show_arm(state="ENABLED")
    shown = status(kinematic)
    assert shown.exit_code == 0 and shown.stdout.splitlines()[-1] == f"first: PSM1 waits: {NAMED}"


def test_a_teleoperation_that_stopped_says_why_and_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = {"state": "DISABLED", "reason": "PSM1 has no jaw"}
    monkeypatch.setattr(standing, "_text", lambda _, field: shown[field])
    monkeypatch.setattr(standing, "_flag", lambda *_: False)
    error = {"text": "A_B: PSM1 has no jaw", "hint": codes.NO_JAW.remedy}
    monkeypatch.setattr(standing, "_events", lambda *_: None)
    monkeypatch.setattr(standing, "_last_error", lambda *_: error)
    assert standing._teleop("s", process("A_B"), Any).reason == f"PSM1 has no jaw; {codes.NO_JAW.remedy}"


@pytest.mark.parametrize(("follows", "reason", "is_first"), [
    (False, "waiting: the pose of PSM1 in its reference frame is not known", True),
    (False, "PSM1 is not homed anymore; trocar home PSM1, then enable teleoperation again", True),
    (False, "waiting: MTML is silent", True),
    (False, "waiting: MTML, PSM1 are silent", True),
    (False, waiting_for("MTML", Start(0.3, 0.1, is_active=False, is_moving=True)), False),
    (False, "waiting: asked to align only, not to follow", False),
    (True, "out of reach", False),
])
def test_a_teleoperation_that_does_not_follow_although_it_is_on_comes_before_all_well(
    monkeypatch: pytest.MonkeyPatch, follows: bool, reason: str, is_first: bool,
) -> None:
    monkeypatch.setattr(standing, "_text", lambda _, field: {"state": "ALIGNING_MTM", "reason": reason}[field])
    monkeypatch.setattr(standing, "_flag", lambda *_: follows)
    monkeypatch.setattr(standing, "_events", lambda *_: None)
    teleop = standing._teleop("s", process("A_B", kind="teleop"), Any)
    console = Standing("console", "console", "teleoperation on, camera")
    assert (first_thing([], [console, teleop]) == f"A_B: {reason}") is is_first
    absent = dataclasses.replace(console, reason="the operator: pedal or head sensor")
    off = dataclasses.replace(console, state=standing.OFF)
    for other in (absent, off):
        assert not first_thing([], [other, teleop]).startswith(f"A_B: {reason}") or teleop.silent
    assert first_thing([], [console, teleop, fault("PSM1", "amplifier", 1)]).startswith("PSM1: amplifier")


@pytest.mark.parametrize(("flags", "state", "reason"), [
    (("valid",), "teleoperation off", "an operator's command: trocar send console teleop_enable 1"),
    (("valid", "teleop_enabled", "clutch"), "teleoperation on, clutch", "the operator: pedal or head sensor"),
    (("valid", "teleop_enabled", "operator_present", "camera"), "teleoperation on, camera", ""),
    (("teleop_enabled", "operator_present"), "teleoperation on",
     "one of its inputs is silent: the operator counts as absent"),
])
def test_a_console_says_what_it_waits_for(monkeypatch: pytest.MonkeyPatch, flags: tuple[str, ...], state: str,
                                          reason: str) -> None:
    monkeypatch.setattr(standing, "_flag", lambda _, field: field in flags)
    found = standing._console("s", process("console"), Any)
    assert (found.state, found.reason) == (state, reason)


def fault(name: str, code: str, stamp_ns: int) -> Standing:
    return Standing(name, "arm", "FAULT", False, f"{name}: {code}", fault={
        "code": code, "hint": "", "monotonic_ns": stamp_ns})


def process(name: str, problem: str = "", kind: str = "arm", lifecycle: str = "RUNNING") -> ProcessStatus:
    state = "STOPPED" if problem.startswith(("failed", "not running")) else "RUNNING"
    return ProcessStatus(name, kind, state, 1, None, None, None, 0, 0, 0, 0, 0, "", "", None, problem, {},
                         lifecycle=lifecycle)


@pytest.mark.parametrize(("processes", "found", "first"), [
    ([process("IO1", "dead", lifecycle="STOPPED"), process("PSM1")], [fault("PSM1", "io-timeout", 5)],
     "IO1 is dead: trocar start IO1; trocar logs IO1 may say why"),
    ([process("supervisor", "dead", "supervisor")], [], "supervisor is dead: trocar up FILE starts the system again"),
    ([process("supervisor", "stalled", "supervisor")], [],
     "supervisor is stalled: trocar down; then trocar up FILE starts the system again"),
    ([process("mine", "stalled", "user")], [], "mine is stalled: trocar restart mine"),
    ([process("mine", "failed: no sensor", "user", "STOPPED")], [],
     "mine failed: no sensor: trocar start mine once its cause is removed; trocar logs mine may say why"),
    ([process("mine", "no sensor", "user")], [], "mine: no sensor: trocar logs mine"),
    ([process("theirs", "dead", "third_party", "")], [],
     "theirs is dead: it is a third-party program; start it again"),
    ([], [fault("PSM1", "shared-board", 1), fault("PSM2", "amplifier", 2)],
     "PSM2: amplifier. Then: trocar home PSM2 PSM1"),
    ([], [fault("PSM1", "power-lost", 3), fault("PSM2", "watchdog", 2)], "PSM2: watchdog. Then: trocar home PSM2 PSM1"),
    ([], [Standing("PSM1", "arm", "FAULT", False)], "PSM1 is in FAULT. Then: trocar home PSM1"),
    ([process("PSM1")], [Standing("PSM1", "arm", "ENABLED HOMED", True)], ""),
    ([], [Standing("A_B", "teleop", "ENABLED", None, "the operator to hold the master")], ""),
])
def test_the_cause_comes_before_what_follows_from_it(
    processes: list[ProcessStatus], found: list[Standing], first: str
) -> None:
    assert first_thing(processes, found) == first


def test_a_process_that_was_restarted_just_now_is_not_well_yet() -> None:
    why = "code 4: Refused; automatic restart 1 of 5; trocar logs b"
    again = dataclasses.replace(process("b", kind="user"), restarts=8, restarted_s=3.0, exit_reason=why)
    assert first_thing([again], []) == f"b was restarted 3.0 s ago: {why}", "there is one count, that of the limit"
    assert first_thing([dataclasses.replace(again, restarted_s=None)], []) == ""


@pytest.mark.parametrize("state", ["CREATED", "STARTING", "RESTARTING", "FAILED"])
def test_one_that_restarts_by_itself_keeps_its_reason_and_needs_no_command(state: str) -> None:
    why = "killed by SIGKILL; automatic restart 2 of 5"
    one = dataclasses.replace(process("nudge", kind="user"), state=state, exit_reason=why)
    assert first_thing([one], []) == f"nudge is not up yet: {why}"
    said = dataclasses.replace(one, exit_reason="hung for 5.0 s, killed; where: a line, trocar logs nudge")
    assert first_thing([said], []).endswith(": hung for 5.0 s, killed; where: a line, trocar logs nudge")


@pytest.mark.parametrize(("rows", "first"), [
    ([("PSM1", "CREATED", "RUNNING")], "PSM1 is not up yet; wait for it"),
    ([("PSM1", "STARTING", "RUNNING"), ("ECM", "RESTARTING", "RESTARTING")], "PSM1, ECM are not up yet; wait for it"),
    ([("PSM1", "STOPPED", "STOPPED"), ("MTM", "NOT ATTACHED", "")], ""),
])
def test_who_is_not_up_yet_is_waited_for(rows: list[tuple[str, str, str]], first: str) -> None:
    assert first_thing([dataclasses.replace(process(name), state=state, lifecycle=lifecycle)
                        for name, state, lifecycle in rows], []) == first


def test_what_a_dead_process_left_says_how_old_it_is() -> None:
    one = Standing("PSM1", "arm", "ENABLED HOMED", True, "", age_s=12.3)
    assert standing.cells(one) == ("PSM1", "ENABLED HOMED, 12 s ago", "–", "")


def test_a_remedy_that_a_problem_names_is_not_repeated() -> None:
    hung = process("bloop", "not running: hung for 5.0 s, killed; where: trocar logs bloop", "user")
    assert first_thing([hung], []).endswith("where: trocar logs bloop: trocar start bloop")
    own = "stopped: power was lost; again: trocar send box keep_in 1"
    assert first_thing([process("box", own, "user")], []) == f"box: {own}"


def test_a_third_party_program_that_hangs_is_ended_first() -> None:
    silent = dataclasses.replace(process("MTMR", "silent"), kind="third_party", lifecycle="", pid=3788)
    assert first_thing([silent], []).endswith("end it (kill 3788), then start it again")
    dead = dataclasses.replace(silent, problem="dead", lives=False)
    assert first_thing([dead], []) == "MTMR is dead: it is a third-party program; start it again"


def test_the_next_step_leads_to_teleoperation() -> None:
    off, homed = Standing("PSM1", "arm", "DISABLED", False), Standing("PSM2", "arm", "ENABLED HOMED", True)
    powered, console = Standing("PSM1", "arm", "ENABLED", False), Standing("console", "console", "teleoperation off")
    assert next_step([off, console]) == "trocar home" and next_step([off, homed, console]) == ""
    assert next_step([powered, homed, console]) == "trocar home PSM1"
    assert next_step([homed, console]) == "trocar send console teleop_enable 1" and next_step([homed]) == ""
    assert next_step([dataclasses.replace(homed, state="PAUSED"), console]) == "trocar send PSM2 state_command resume"
    on, waits = Standing("console", "console", standing.ON), Standing("A_B", "teleop", "ALIGNING_MTM", reason="waiting")
    assert next_step([homed, on, waits]) == "A_B: waiting"
    assert next_step([homed, on, dataclasses.replace(waits, state="ENABLED, following")]) == ""


def test_a_filter_whose_host_died_is_no_third_party_program() -> None:
    dead = dataclasses.replace(process("speed", "dead", "user", ""), host="lab", lives=False)
    assert first_thing([dead], []).startswith("speed is dead: trocar restart lab")


def test_what_waits_for_a_silent_process_is_not_well() -> None:
    one = Standing("MTMR_PSM1", "teleop", "SETTING_ARMS_STATE", None, "waiting: MTMR is silent", silent=True)
    assert first_thing([], [one]) == "MTMR_PSM1: waiting: MTMR is silent"
    ended = Standing("MTMR", "third_party", "ENABLED", True, "start its program again: recorded_master", age_s=3.0)
    assert first_thing([], [ended, one]) == (
        "MTMR_PSM1: waiting: MTMR is silent; MTMR: start its program again: recorded_master")


def test_home_says_what_an_arm_waits_for(kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.tools.client.bring_up.PATIENCE_NS", 0)
    kinematic.arm.field("reason")[...] = NAMED.encode()
    kinematic.show_arm(state="ENABLED")
    stop = threading.Event()

    def accept() -> None:
        while not stop.is_set():
            for command in kinematic.mailbox.drain():
                command.accept()
            pause(0.001)

    answering = threading.Thread(target=accept)
    answering.start()
    try:
        shown = CliRunner().invoke(APP, ["home", "--timeout", "0.3", "--system", kinematic.name])
    finally:
        stop.set()
        answering.join()
    assert shown.exit_code == 1
    assert shown.stderr.splitlines().count(f"PSM1 waits: {NAMED}") == 1
    assert NAMED in " ".join(shown.stdout.split())


class Waiting:
    """The record of an arm that waits."""

    name, state = "PSM1", "ENABLED"

    def __init__(self) -> None:
        self.reason = ""

    def text(self, field: str) -> str:
        return self.reason


def test_short_waits_are_no_news_and_long_ones_are_told_once() -> None:
    watch: Any = Waiting()
    none: Any = None
    bring_up, second = ArmBringUp(watch, none, none, "homed", 0.0, simulated=False), 10**9
    watch.reason = "brakes to release"
    now = monotonic_ns()
    assert bring_up.news(now) == "" and bring_up.news(now + second // 2) == ""
    watch.reason = NAMED
    reported = [bring_up.news(now + k * second // 4) for k in range(4, 40)]
    assert list(filter(None, reported)) == [f"PSM1 waits: {NAMED}"]


def test_what_the_scheduler_refused_is_said_once_with_where_the_remedy_is(kinematic: ScriptedRobot) -> None:
    for name, policy in (("supervisor", b"other"), ("IO1", b"no FIFO, not locked"), ("PSM1", b"no FIFO, locked")):
        kinematic.pages[name].field("policy")[...] = policy
    shown = status(kinematic).stdout
    (line,) = [line for line in shown.splitlines() if "no real-time priority" in line]
    assert "IO1, PSM1" in line and "trocar doctor" in line
    assert "other" not in shown and "no FIFO" not in shown and "\nPSM1: locked" in shown


def test_a_fault_comes_before_what_is_wrong_with_the_recorder_and_after_a_dead_arm() -> None:
    fault = Standing("PSM1", "arm", "FAULT", False, "PSM1: power was lost")
    recorder, arm = process("recorder", "the disk is full", "recorder"), process("PSM2", "dead")
    slow = process("PSM1", "runs at 440.1 Hz instead of 1500")
    assert first_thing([recorder, slow], [fault]).startswith("PSM1: power was lost")
    assert first_thing([recorder, arm], [fault]).startswith("PSM2 is dead")
    assert first_thing([recorder, slow], []).startswith("PSM1: runs at 440.1 Hz")
    assert first_thing([recorder], []).startswith("recorder: the disk is full")


def test_an_arm_on_its_way_is_not_well_yet() -> None:
    one = Standing("PSM1", "arm", "DISABLED POWERING", False, "no motor power")
    assert first_thing([], [one]) == "wait for PSM1: DISABLED POWERING, no motor power"


def test_setup_joints_that_are_unknown_are_not_well(monkeypatch: pytest.MonkeyPatch) -> None:
    record = np.zeros((), [("state", "S16"), ("sub_state", "S16"), ("reason", "S40"), ("is_homed", "?"),
                           ("setup_valid", "?", 2)])
    record["state"] = record["sub_state"] = b"ENABLED"
    record["is_homed"], record["setup_valid"] = True, (True, False)
    reader = Mock(info={"setups": {"ECM": 4, "PSM1": 6}}, field=record.__getitem__)
    one = standing._setup_joints("s", process("SUJ", kind="suj"), reader)
    assert first_thing([], [one]).startswith("wait for SUJ: ENABLED, the joints of PSM1 are unknown")
    nameless = Mock(info={}, field=record.__getitem__)
    assert standing._setup_joints("s", process("SUJ", kind="suj"), nameless).reason == "", "of a recording without them"
    record["setup_valid"] = True
    assert first_thing([], [standing._setup_joints("s", process("SUJ", kind="suj"), reader)]) == ""
