"""The command line on a system that the test plays itself."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from tests.tools.robot import JOINTS, ScriptedRobot, nothing_ages, robot
from trocar.procs.tables import codes
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import SETTING, Argument, CommandRow, listed
from trocar.shm.memory.parts import remove_all
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools import cli
from trocar.tools.output.errors import Misuse
from trocar.tools.systems.find import left_over
from trocar.tools.verbs.send import parsed

APP = cli.build()


@pytest.fixture
def kinematic(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    nothing_ages(monkeypatch)
    with robot(world.name) as made:
        yield made


def run(*words: str) -> Result:
    return CliRunner().invoke(APP, list(words))


def lines(result: Result) -> list[dict[str, Any]]:
    assert result.exit_code == 0, result.output + result.stderr
    return [json.loads(line) for line in result.stdout.splitlines()]


def test_every_verb_has_help_with_an_example() -> None:
    for verb in cli.VERBS:
        result = run(verb.name, "--help")
        assert result.exit_code == 0, result.output
        assert "Example: trocar " + verb.name in " ".join(result.output.split()), verb.name


def test_help_shows_every_word_of_its_sentences() -> None:
    """Words in square brackets are markup of the terminal, which swallows them."""
    doors = [(words, door) for verb in cli.VERBS for words, door in (
        [((verb.name, part.name), part.door) for part in verb.parts] or [((verb.name,), verb.door)])]
    for words, door in doors:
        module, _, function = door.partition(":")
        text = getattr(importlib.import_module(f"trocar.tools.{module}"), function).__doc__
        shown = " ".join(run(*words, "--help").output.split())
        assert [part for part in text.split("\n\n") if " ".join(part.split()) not in shown] == [], words


def test_help_marks_verbs_that_may_change_the_robot() -> None:
    text = run("--help").output
    moving, looking = text.split(cli.PANELS[False])
    for verb in cli.VERBS:
        part = moving if verb.moves else looking
        assert f" {verb.name} " in part


def test_a_word_from_the_text_of_a_verb_leads_to_it() -> None:
    assert "did you mean scope, " in " ".join(run("plot").stderr.split())


def test_a_wrong_verb_is_misuse() -> None:
    done = subprocess.run([sys.executable, "-m", "trocar", "fly"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "fly" in done.stderr


def test_help_imports_no_verb() -> None:
    code = "import sys; sys.argv=['trocar','--help']\nfrom trocar.tools.cli import main\n"
    code += "try: main()\nexcept SystemExit: pass\n"
    code += "print([m for m in ('numpy', 'trocar.tools.verbs.status', 'pinocchio') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_an_absent_system_is_named(world: Any) -> None:
    result = run("status", "--system", world.name)
    assert result.exit_code == 1
    assert f"no system {world.name} is up" in result.stderr


def test_echo_prints_a_view_as_json(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(0.25)
    (row,) = lines(run("echo", "PSM1/measured_js", "--once", "--json", "--system", kinematic.name))
    assert row["name"] == list(JOINTS)
    assert row["position"] == [0.25] * 6
    assert row["velocity"] == [None] * 6  # not finite
    assert row["valid"] is True
    assert row["sequence"] == 1


@pytest.mark.slow
def test_invalid_values_are_null(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(valid=False, jaw=False)
    (js,) = lines(run("echo", "PSM1/measured_js", "--once", "--json", "--system", kinematic.name))
    (cp,) = lines(run("echo", "PSM1/measured_cp", "--once", "--json", "--system", kinematic.name))
    (jaw,) = lines(run("echo", "PSM1/jaw/measured_js", "--once", "--json", "--system", kinematic.name))
    assert (js["valid"], js["position"]) == (False, None)
    assert (cp["position"], cp["orientation"]) == (None, None)
    assert (jaw["valid"], jaw["position"]) == (False, None)


def test_echo_knows_poses_jaws_and_jacobians(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(0.5)
    (cp,) = lines(run("echo", "PSM1/measured_cp", "--once", "--json", "--system", kinematic.name))
    (jaw,) = lines(run("echo", "PSM1/jaw/measured_js", "--once", "--json", "--system", kinematic.name))
    (jacobian,) = lines(run("echo", "PSM1/body/jacobian", "--once", "--json", "--system", kinematic.name))
    assert cp["position"] == [1, 2, 3]
    assert cp["orientation"] == [0, 0, 0, 1]
    assert (jaw["name"], jaw["position"]) == (["jaw"], [0.5])
    assert np.shape(jacobian["data"]) == (6, 6)


def test_echo_cuts_a_robot_out_of_io(kinematic: ScriptedRobot) -> None:
    kinematic.io.field("valid")[...] = True
    kinematic.io.field("position")[...] = np.arange(7)
    kinematic.io.publish(monotonic_ns())
    (row,) = lines(run("echo", "IO1/PSM1/measured_js", "--once", "--json", "--system", kinematic.name))
    assert row["position"] == list(range(7))
    assert row["name"] == [*JOINTS, "jaw"]


def test_operating_state_comes_from_history(kinematic: ScriptedRobot) -> None:
    kinematic.events.operating_state("ENABLED", "HOMED", True, False)
    kinematic.events.status("something else")
    (row,) = lines(run("echo", "PSM1/operating_state", "--once", "--json", "--system", kinematic.name))
    assert (row["state"], row["sub_state"], row["is_homed"], row["is_busy"]) == ("ENABLED", "HOMED", True, False)
    assert row["sequence"] == 1


def test_operating_state_without_events_comes_from_the_record(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="FAULT")
    (row,) = lines(run("echo", "PSM1/operating_state", "--once", "--json", "--system", kinematic.name))
    assert (row["state"], row["is_homed"], row["is_busy"]) == ("FAULT", False, False)


def test_error_events_carry_their_numbers(kinematic: ScriptedRobot) -> None:
    kinematic.events.report(codes.TRACKING, "joint 2 is off", "PSM1", 2, 0.3)
    (row,) = lines(run("echo", "PSM1/error", "--once", "--json", "--system", kinematic.name))
    assert (row["code"], row["axis"], row["value"], row["limit"]) == ("tracking", 2, 0.3, None)


def test_an_unknown_topic_names_the_nearest(kinematic: ScriptedRobot) -> None:
    result = run("echo", "PSM1/mesured_js", "--once", "--system", kinematic.name)
    assert result.exit_code == 1
    assert "PSM1/measured_js" in result.stderr


def test_a_topic_nobody_wrote_is_an_error(kinematic: ScriptedRobot) -> None:
    result = run("echo", "PSM1/state", "--once", "--timeout", "0", "--system", kinematic.name)
    assert result.exit_code == 1
    assert "nothing yet" in result.stderr


def test_list_shows_records_views_and_events(kinematic: ScriptedRobot) -> None:
    rows = {row["topic"]: row for row in lines(run("list", "--json", "--system", kinematic.name))}
    assert rows["PSM1/measured_js"]["kind"] == "js"
    assert rows["IO1/PSM1/measured_js"]["rate_hz"] == 1500
    assert rows["PSM1/operating_state"]["kind"] == "event"
    assert {f["unit"] for f in rows["PSM1/state"]["fields"]} >= {"rad|m", "m, -"}
    assert "PSM1/jaw/measured_js" in run("list", "--system", kinematic.name).stdout
    assert "measured joint position" in run("list", "-v", "--system", kinematic.name).stdout


def test_hz_of_a_silent_topic_is_wrong(kinematic: ScriptedRobot) -> None:
    result = run("hz", "PSM1/state", "--window", "0.05", "--json", "--system", kinematic.name)
    assert result.exit_code == 1


def test_status_shows_every_process(kinematic: ScriptedRobot) -> None:
    stop = threading.Event()

    def beat() -> None:
        while not stop.is_set():
            kinematic.beat()
            pause(0.001)

    beating = threading.Thread(target=beat)
    beating.start()
    kinematic.restarted(2, "killed by SIGKILL")
    try:
        (status,) = lines(run("status", "--json", "--system", kinematic.name))
    finally:
        stop.set()
        beating.join()
    rows = {row["name"]: row for row in status["processes"]}
    assert set(rows) == {"supervisor", "IO1", "PSM1"}
    assert (rows["PSM1"]["restarts"], rows["PSM1"]["exit_reason"]) == (2, "killed by SIGKILL")
    assert rows["IO1"]["kind"] == "io"


def test_status_finds_stalled_and_failed_processes(kinematic: ScriptedRobot) -> None:
    kinematic.pages["IO1"].field("heartbeat_ns")[...] = monotonic_ns() - 10**9
    kinematic.pages["PSM1"].show("FAILED", "no such file")
    result = run("status", "--json", "--system", kinematic.name)
    rows = {row["name"]: row for row in json.loads(result.stdout)["processes"]}
    assert result.exit_code == 1
    assert rows["IO1"]["problem"] == "stalled"
    assert rows["PSM1"]["problem"] == "failed: no such file"


@pytest.mark.parametrize(("silent_s", "problem"), [(1, ""), (3, "stalled")])
def test_a_process_may_be_silent_for_longer_in_simulated_time(
        kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch, silent_s: int, problem: str) -> None:
    monkeypatch.setattr("trocar.tools.inspect.processes.is_simulated", lambda system: True)
    kinematic.pages["IO1"].field("heartbeat_ns")[...] = monotonic_ns() - silent_s * 10**9
    result = run("status", "--json", "--system", kinematic.name)
    rows = {row["name"]: row for row in json.loads(result.stdout)["processes"]}
    assert rows["IO1"]["problem"] == problem


def test_attach_prints_one_page(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    kinematic.arm.field("reason")[...] = b"brakes to release"
    kinematic.show_arm(state="ENABLED")
    for _ in range(2):
        kinematic.events.report(codes.TRACKING, "something broke")
    kinematic.events.report(codes.CURRENT, "and another thing")
    text = run("attach", "--once", "--system", kinematic.name).stdout
    assert "PSM1/state" in text and "brakes to release" in text
    assert 0 < text.index("and another thing") < text.index("something broke")  # newest first
    assert text.count("something broke") == 1


def answer(kinematic: ScriptedRobot, how: str) -> threading.Thread:
    """One command is answered, as an arm would."""

    def loop() -> None:
        end = monotonic_ns() + 10 * 10**9
        while monotonic_ns() < end:
            for command in kinematic.mailbox.drain():
                received.append((command.name, command.values.tolist(), command.text))
                command.done() if how == "done" else command.refuse(how)
                return
            pause(0.001)

    received: list[Any] = []
    thread = threading.Thread(target=loop)
    thread.received = received  # type: ignore[attr-defined]
    thread.start()
    return thread


def test_send_prints_the_answer(kinematic: ScriptedRobot) -> None:
    thread = answer(kinematic, "done")
    result = run("send", "PSM1", "servo_jp", "-0.1", "0", "0.12", "0", "0", "-1e-3", "--system", kinematic.name)
    thread.join()
    assert result.exit_code == 0, result.stderr
    assert result.stdout.strip() == "done"
    assert thread.received == [("servo_jp", [-0.1, 0, 0.12, 0, 0, -1e-3], "")]  # type: ignore[attr-defined]


def test_send_tells_why_it_was_refused(kinematic: ScriptedRobot) -> None:
    thread = answer(kinematic, "home is not allowed in DISABLED")
    result = run("send", "PSM1", "state_command", "home", "--system", kinematic.name)
    thread.join()
    assert result.exit_code == 1
    assert "home is not allowed in DISABLED" in result.stderr
    assert thread.received == [("state_command", [], "home")]  # type: ignore[attr-defined]


def test_send_without_a_command_lists_them(kinematic: ScriptedRobot) -> None:
    result = run("send", "PSM1", "--system", kinematic.name)
    assert result.exit_code == 0
    assert any(line.split()[:2] == ["move_jp", "position"] for line in result.stdout.splitlines())
    rows = [json.loads(line) for line in run("send", "PSM1", "--json", "--system", kinematic.name).stdout.splitlines()]
    known = [command.name for command in COMMANDS["arm"] if "PSM" in (command.types or ("PSM",))]
    assert [row["name"] for row in rows] == known
    assert rows[0]["component"] == "PSM1"


def test_send_names_the_nearest_command(kinematic: ScriptedRobot) -> None:
    result = run("send", "PSM1", "move_jq", "--system", kinematic.name)
    assert result.exit_code == 1
    assert "move_jp" in result.stderr
    assert "PSM1" in run("send", "PSM9", "hold", "--system", kinematic.name).stderr


def test_send_without_an_owner_times_out(kinematic: ScriptedRobot) -> None:
    result = run("send", "PSM1", "hold", "--timeout", "0.05", "--system", kinematic.name)
    assert result.exit_code == 1
    assert "did not answer hold" in result.stderr


def test_words_become_numbers_and_text() -> None:
    both = listed(CommandRow("x", SETTING, "", (Argument("on"),), "robot"))
    assert parsed(both, ["1", "PSM1"]) == ([1.0], "PSM1")
    assert parsed(listed(CommandRow("x", SETTING, "", text="robot")), ["7"]) == ([], "7")
    with pytest.raises(Misuse, match="takes on"):
        parsed(listed(CommandRow("x", SETTING, "", (Argument("on"),))), ["yes"])
    with pytest.raises(Misuse, match="finite"):
        parsed(both, ["nan"])
    with pytest.raises(Misuse, match=r"1 given; 'PSM1 roll' was taken as its text \(robot\)"):
        parsed(listed(CommandRow("x", SETTING, "", (Argument("axis"), Argument("on")), "robot")), ["PSM1", "roll", "1"])


def test_down_clears_what_a_dead_system_left(world: Any) -> None:
    made = ScriptedRobot(world.name)
    assert left_over(world.name) == []
    for page in made.pages.values():
        page.close()
    assert left_over(world.name) == [world.name]
    result = run("down", "--json", "--system", world.name)
    made.close()
    assert json.loads(result.stdout)["cleared"][world.name] > 5
    assert remove_all(world.name) == 0


def test_up_with_a_wrong_option_is_misuse() -> None:
    assert run("up", "--boards", "wooden").exit_code == 2
