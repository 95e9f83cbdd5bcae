"""`trocar power-on`, `home` and `power-off` on a system that the test plays itself."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable

import pytest

from tests.tools.robot import ScriptedRobot
from tests.tools.test_verbs import kinematic as kinematic  # a fixture
from tests.tools.test_verbs import lines, run
from trocar.procs.tables import codes
from trocar.procs.tables.bring_up import DISABLED
from trocar.shm.mailbox.received import Received
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client import bring_up, remote
from trocar.tools.inspect.watch import Amplifiers, Watch
from trocar.tools.systems.processes import ParentProcess


def play_arm(kinematic: ScriptedRobot, script: dict[str, tuple[str, bool]], commands: int) -> threading.Thread:
    """An arm that answers state commands by going to the state the script gives for the word."""

    def loop() -> None:
        left, end = commands, monotonic_ns() + 10 * 10**9
        while left and monotonic_ns() < end:
            for command in kinematic.mailbox.drain():
                left -= 1
                command.done()
                state, homed = script[command.text]
                if state == "FAULT":
                    kinematic.events.report(codes.POWER_FAULT, "the supply is off")
                kinematic.show_arm(state=state, homed=homed)
            pause(0.001)

    thread = threading.Thread(target=loop)
    thread.start()
    return thread


def answer(kinematic: ScriptedRobot, say: Callable[[Received], object]) -> threading.Thread:
    """An arm that answers one command and shows what it showed before."""

    def loop() -> None:
        end, heard = monotonic_ns() + 10 * 10**9, 0
        while not heard and monotonic_ns() < end:
            for command in kinematic.mailbox.drain():
                heard += 1
                say(command)
            pause(0.001)

    thread = threading.Thread(target=loop)
    thread.start()
    return thread


def test_home_disables_faults_and_enables_first(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="FAULT")
    script = {"disable": ("DISABLED", False), "enable": ("ENABLED", False), "home": ("ENABLED", True)}
    thread = play_arm(kinematic, script, 3)
    (row,) = lines(run("home", "--json", "--system", kinematic.name))
    thread.join()
    assert row == {"arm": "PSM1", "goal": "homed", "done": True, "problem": None}


def test_power_on_tells_the_arms_error(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="DISABLED")
    thread = play_arm(kinematic, {"enable": ("FAULT", False)}, 1)
    result = run("power-on", "PSM1", "--json", "--system", kinematic.name)
    thread.join()
    assert result.exit_code == 1
    assert json.loads(result.stdout)["problem"] == f"the supply is off; {codes.POWER_FAULT.remedy}"


def test_power_off_that_takes_too_long_says_so(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    thread = play_arm(kinematic, {"disable": ("ENABLED", False)}, 1)
    result = run("power-off", "--timeout", "0.1", "--json", "--system", kinematic.name)
    thread.join()
    assert result.exit_code == 1
    assert json.loads(result.stdout)["problem"] == "not disabled in time; it is ENABLED", "the state once"


@pytest.mark.parametrize(("age_s", "io_age_s", "amp_on", "problem"), [
    (0.0, 0.0, False, None), (0.0, 0.0, True, "IO1 sees amplifiers that are on"),
    (0.0, 60.0, False, "IO1: its last record is "), (60.0, 0.0, False, "its last record is "),
    (0.0, None, False, "IO1 has not shown its state"),
])
def test_power_is_off_when_io_sees_it(
    kinematic: ScriptedRobot, age_s: float, io_age_s: float | None, amp_on: bool, problem: str | None
) -> None:
    kinematic.show_arm(state="DISABLED", age_s=age_s)
    kinematic.io.field("amp_on")[6] = amp_on
    if io_age_s is not None:
        kinematic.io.publish(monotonic_ns() - round(io_age_s * 1e9))
    asked: list[str] = []
    thread = answer(kinematic, lambda command: (asked.append(command.text), command.done()))
    result = run("power-off", "--timeout", "0.05", "--json", "--system", kinematic.name)
    thread.join()
    assert result.exit_code == (1 if problem else 0) and asked == ["disable"]
    reported = json.loads(result.stdout)["problem"]
    assert reported is None if problem is None else problem in reported


def test_an_arm_that_does_not_confirm_is_not_taken_for_off(kinematic: ScriptedRobot,
                                                           monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bring_up, "ANSWER_S", 0.1)
    kinematic.show_arm(state="DISABLED")
    kinematic.io.publish(monotonic_ns())
    result = run("power-off", "--json", "--system", kinematic.name)
    assert json.loads(result.stdout)["problem"].startswith("did not answer state_command within 0.1 s")


@pytest.mark.parametrize("say", [Received.accept, lambda command: command.fail("io does not answer"),
                                 lambda command: command.refuse("no authority")])
def test_power_off_is_not_done_when_the_arm_did_not_do_it(kinematic: ScriptedRobot,
                                                          say: Callable[[Received], object]) -> None:
    kinematic.show_arm(state="DISABLED")
    kinematic.io.publish(monotonic_ns())
    thread = answer(kinematic, say)
    result = run("power-off", "--timeout", "0.1", "--json", "--system", kinematic.name)
    thread.join()
    assert result.exit_code == 1 and not json.loads(result.stdout)["done"]


@pytest.mark.parametrize("state", ["CREATED", "STARTING"])
def test_an_arm_that_starts_gets_its_word_later_and_keeps_no_other_waiting(
        kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch, state: str) -> None:
    kinematic.show_arm(state="ENABLED")
    monkeypatch.setattr(remote, "pause", pytest.fail)
    with Watch(kinematic.name, "PSM1") as watch, remote.Remote(kinematic.name, "PSM1") as to, \
            Amplifiers(kinematic.name, "PSM1") as amplifiers:
        one = bring_up.ArmBringUp(watch, to, amplifiers, DISABLED, 0.0, simulated=False)
        kinematic.pages["PSM1"].show(state)
        one.step()
        assert not [*kinematic.mailbox.drain(0)] and not one.over
        kinematic.pages["PSM1"].show("RUNNING")
        one.step()
        assert [command.text for command in kinematic.mailbox.drain(0)] == ["disable"]


def test_an_arm_that_does_not_answer_keeps_no_other_waiting(kinematic: ScriptedRobot,
                                                            monkeypatch: pytest.MonkeyPatch) -> None:
    kinematic.show_arm(state="ENABLED")
    monkeypatch.setattr(remote, "pause", pytest.fail)
    with Watch(kinematic.name, "PSM1") as watch, remote.Remote(kinematic.name, "PSM1") as to, \
            Amplifiers(kinematic.name, "PSM1") as amplifiers:
        one = bring_up.ArmBringUp(watch, to, amplifiers, DISABLED, 0.0, simulated=False)
        one.step()
        assert [command.text for command in kinematic.mailbox.drain(0)] == ["disable"] and not one.over


def test_a_command_that_another_one_cancelled_is_told_at_once(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    thread = answer(kinematic, lambda command: (command.accept(), command.fail("disable was requested")))
    result = run("home", "--json", "--system", kinematic.name)
    thread.join()
    assert json.loads(result.stdout)["problem"] == "home failed: disable was requested"


def test_a_homed_arm_that_hangs_is_not_taken_for_homed(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED", homed=True, age_s=60.0)
    for verb in ("home", "power-on"):
        result = run(verb, "--timeout", "0.05", "--json", "--system", kinematic.name)
        assert result.exit_code == 1 and "its last record is " in json.loads(result.stdout)["problem"]


def test_home_of_an_unknown_arm_names_those_there_are(kinematic: ScriptedRobot) -> None:
    result = run("home", "PSM7", "--system", kinematic.name)
    assert result.exit_code == 1
    assert "PSM1" in result.stderr


@pytest.mark.parametrize(("command", "counts"), [
    (("python", "-P", "-m", "trocar", "commission", "site.json"), True),
    (("python", "/x/bin/trocar", "commission", "site.json"), True),
    (("python", "-m", "trocar", "demo", "--system", "commission"), False), (("bash",), False),
])
def test_while_a_commissioning_runs_a_system_others_do_not_power_it(
    kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...], counts: bool
) -> None:
    monkeypatch.setattr("trocar.tools.systems.processes.parent_of", lambda pid: ParentProcess(4711, command))
    monkeypatch.setattr("trocar.tools.inspect.processes._stalled", lambda *process: False)  # nothing beats here
    kinematic.show_arm(state="ENABLED", homed=True)
    assert ("as trocar commission (pid 4711) says" in run("status", "--system", kinematic.name).stdout) == counts
    if counts:
        for verb in ("home", "power-on"):
            refused = run(verb, "--system", kinematic.name)
            assert refused.exit_code == 1 and "pid 4711" in refused.output
        assert "trocar commission" not in run("power-off", "--timeout", "0.1", "--system", kinematic.name).output


@pytest.mark.parametrize(("words", "stop"), [
    (("home", "PSM1"), "trocar power-off PSM1"), (("power-on",), "trocar power-off"), (("power-off",), ""),
    (("send", "PSM1", "state_command", "home", "--wait"), "trocar power-off"),
    (("send", "PSM1", "state_command", "disable", "--wait"), ""),
    (("send", "PSM1", "move_jp", "0", "0", "0.1", "0", "0", "0", "--wait"), "trocar send PSM1 hold"),
])
def test_ctrl_c_says_that_the_command_continues(kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch,
                                              words: tuple[str, ...], stop: str) -> None:
    def pressed(seconds: float) -> None:
        raise KeyboardInterrupt

    kinematic.show_arm(state="ENABLED")
    for module in (bring_up, remote):
        monkeypatch.setattr(module, "pause", pressed)
    result = run(*words, "--system", kinematic.name)
    assert result.exit_code == 130
    assert "continues" in result.stderr and (f"; {stop} stops" in result.stderr if stop else ";" not in result.stderr)


@pytest.mark.parametrize(("state", "word", "effect"), [
    ("DISABLED", "enable", "arms may still get power, PSM1 will not be homed; trocar power-off stops them"),
    ("FAULT", "disable", "arms may still lose power, PSM1 will not be homed; trocar power-off stops them"),
    ("ENABLED", "home", "the command continues: arms may move; trocar power-off stops them"),
])
def test_ctrl_c_in_home_says_which_step_continues(kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch,
                                                 state: str, word: str, effect: str) -> None:
    def pressed(seconds: float) -> None:
        raise KeyboardInterrupt

    kinematic.show_arm(state=state)
    thread = play_arm(kinematic, {word: (state, False)}, 1)
    monkeypatch.setattr(bring_up, "pause", pressed)
    result = run("home", "--system", kinematic.name)
    thread.join()
    assert result.stderr.endswith(f"stopped by Ctrl-C, but {effect}\n")
