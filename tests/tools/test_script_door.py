"""`import trocar`: what a user's script sees of an arm that the test plays."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import trocar
from tests.tools.robot import ScriptedRobot, nothing_ages, robot
from trocar.procs.machine.paths import ROOT
from trocar.shm.time.clock import monotonic_ns, pause


@pytest.fixture
def kinematic(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    nothing_ages(monkeypatch)
    with robot(world.name) as made:
        yield made


def reported(kinematic: ScriptedRobot, answer: Callable[[Any], object]) -> threading.Thread:
    """The arm answers one command."""

    def loop() -> None:
        end = monotonic_ns() + 10 * 10**9
        while monotonic_ns() < end:
            for command in kinematic.mailbox.drain():
                answer(command)
                return
            pause(0.001)

    thread = threading.Thread(target=loop)
    thread.start()
    return thread


def answering(kinematic: ScriptedRobot, *outcomes: str) -> threading.Thread:
    """The arm answers one command with each of the outcomes in turn."""

    def each(command: Any) -> None:
        for outcome in outcomes:
            kinematic.show_arm(0.3, state="ENABLED")
            getattr(command, outcome)()

    return reported(kinematic, each)


def test_reads_return_value_and_stamp(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(0.25, state="ENABLED", homed=True)
    with trocar.arm("PSM1", kinematic.name) as psm:
        position, stamp_ns = psm.measured_jp()
        assert position.tolist() == [0.25] * 6
        assert 0 < stamp_ns <= monotonic_ns()
        pose, _ = psm.measured_cp()
        assert np.allclose(pose[:3, 3], (1, 2, 3))
        assert pose.shape == (4, 4)
        assert psm.body.jacobian()[0].shape == (6, 6)
        assert psm.jaw.measured_jp()[0].tolist() == [0.25]
        assert psm.jaw.setpoint_js()[0].velocity.size == 0
        assert psm.operating_state()[0] == "ENABLED"
        assert psm.is_homed()
        assert not psm.is_busy()


@pytest.mark.parametrize("name", ["psm1", "PSM9"])
def test_a_wrong_name_is_told_at_once_where_the_system_is_up(kinematic: ScriptedRobot, name: str) -> None:
    with pytest.raises(trocar.Problem, match=f"no arm {name}; (did you mean|there are:) PSM1"):
        trocar.arm(name, kinematic.name, timeout=60.0)
    with pytest.raises(trocar.Problem, match="no console consoel"):
        trocar.console("consoel", kinematic.name, timeout=60.0)
    number: Any = 1
    with pytest.raises(trocar.Problem, match="no arm 1; there are: PSM1"):
        trocar.arm(number, kinematic.name, timeout=60.0)


def test_what_is_no_operating_state_is_not_waited_for(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    with trocar.arm("PSM1", kinematic.name) as psm, pytest.raises(ValueError, match="allowed: DISABLED, ENABLED"):
        psm.wait_for_operating_state("ENABLD", 60.0)


def test_a_wrong_word_is_answered_with_the_nearest_ones_of_this_arm(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    with trocar.arm("PSM1", kinematic.name) as psm:
        wrong: Any = psm
        with pytest.raises(AttributeError, match=r"PSM1 has no command move_jq; did you mean .*move_jp"):
            wrong.move_jq([0])
        with pytest.raises(AttributeError, match=r"did you mean .*measured_jp"):
            wrong.measured_jq()
        with pytest.raises(AttributeError, match="PSM1 has no command unlock_orientatio") as told:
            wrong.unlock_orientatio()
        assert "unlock_orientation" not in str(told.value).partition(";")[2]
        with pytest.raises(AttributeError, match="PSM1 has no command lock_orientation"):
            wrong.lock_orientation()


@pytest.mark.slow
def test_a_power_off_is_sent_whatever_its_timeout_is(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    wrong: Any = "x"
    with trocar.arm("PSM1", kinematic.name) as psm, pytest.raises(trocar.Problem):  # nothing answers here
        psm.disable(wrong)
    assert [(asked.name, asked.text) for asked in kinematic.mailbox.drain(0)] == [("state_command", "disable")]


@pytest.mark.parametrize("timeout", ["x", -1, math.inf, math.nan, None])
def test_a_timeout_that_is_none_is_a_wrong_value(kinematic: ScriptedRobot, timeout: Any) -> None:
    kinematic.show_arm()
    with trocar.arm("PSM1", kinematic.name) as psm:
        for call in (psm.process_events, psm.check_connections, psm.home, psm.enable):
            with pytest.raises(ValueError, match="timeout"):
                call(timeout)


def test_a_closed_arm_says_so(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(0.25)
    psm: Any = trocar.arm("PSM1", kinematic.name)
    psm.close()
    psm.close()
    for word in (psm.measured_jp, psm.measured_cp, psm.operating_state, psm.connected, psm.hold, psm.jaw.measured_jp,
                 psm.jaw.open, lambda: psm.move_jp([0.0] * 6), lambda: psm.move_jq,
                 psm.gravity_compensation.setpoint_jf):
        with pytest.raises(trocar.Disconnected, match="PSM1 is closed"):
            word()


def test_a_clipped_insertion_is_warned_of_by_its_name_at_the_line_of_the_script(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    with trocar.psm("PSM1", kinematic.name) as psm:
        thread = reported(kinematic, lambda command: command.accept("clipped: insertion 9.000 → 0.240 m"))
        with pytest.warns(trocar.Clipped, match="PSM1 insert_jp was clipped") as caught:
            psm.insert_jp(9.0)
        thread.join()
    assert [warning.filename for warning in caught] == [__file__]


def test_a_stream_at_its_limit_is_warned_of_once_until_it_is_within_again(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    answers = ("at its limit: insertion", "at its limit: insertion", "", "at its limit: yaw")
    with trocar.psm("PSM1", kinematic.name) as psm, pytest.warns(trocar.Clipped, match="PSM1 servo_cp: at") as caught:
        for answer in answers:
            thread = reported(kinematic, lambda command, answer=answer: command.done(answer))
            psm.servo_cp(np.eye(4))
            thread.join()
    assert [str(warning.message).partition("limit: ")[2] for warning in caught] == ["insertion", "yaw"]
    assert {warning.filename for warning in caught} == {__file__}


def test_a_system_may_be_named_by_the_environment(kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_SYSTEM", kinematic.name)
    assert trocar.system().name == kinematic.name
    monkeypatch.setenv("TROCAR_SYSTEM", f"{kinematic.name}-2")
    with pytest.raises(TimeoutError, match="no system"):
        trocar.arm("PSM1", timeout=0.0)
    assert trocar.system(kinematic.name).name == kinematic.name


def test_a_silent_arm_times_out(kinematic: ScriptedRobot) -> None:
    with pytest.raises(TimeoutError, match="does not show its state"):
        trocar.arm("PSM1", kinematic.name, timeout=0.0)


def test_invalid_values_are_not_handed_out(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(valid=False)
    with trocar.arm("PSM1", kinematic.name) as psm, pytest.raises(TimeoutError, match="not valid"):
        psm.measured_jp()


def test_a_move_is_busy_until_done(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    with trocar.arm("PSM1", kinematic.name) as psm:
        thread = answering(kinematic, "accept", "done")
        handle = psm.move_jp([0] * 6)
        thread.join()
        handle.wait(5.0)
        assert not handle.is_busy()


def test_a_move_that_is_not_done_times_out(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    with trocar.arm("PSM1", kinematic.name) as psm:
        thread = answering(kinematic, "accept")
        handle = psm.move_jp([0] * 6)
        thread.join()
        assert handle.is_busy()
        with pytest.raises(TimeoutError, match="move_jp is not done"):
            handle.wait(0.02)


def test_a_move_that_is_done_at_once_is_not_waited_for(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    with trocar.arm("PSM1", kinematic.name) as psm:
        thread = answering(kinematic, "done")
        assert not psm.move_jp([0] * 6).is_busy()
        thread.join()


def test_a_move_that_fails_says_why(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    with trocar.arm("PSM1", kinematic.name) as psm:
        thread = reported(kinematic, lambda command: (command.accept(), command.fail("replaced by hold")))
        handle = psm.jaw.open()
        thread.join()
        with pytest.raises(trocar.Refused, match="PSM1 jaw/move_jp failed: replaced by hold"):
            handle.wait(5.0)


def test_a_refused_command_raises_the_reason(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    with trocar.arm("PSM1", kinematic.name) as psm:
        asked: list[int] = []
        thread = reported(kinematic,
                          lambda command: (asked.append(len(command.values)), command.refuse("arm not ready")))
        with pytest.raises(trocar.Refused, match="arm not ready"):
            psm.servo_jp([0] * 6, [0] * 6)
        thread.join()
        assert asked == [12]


@pytest.mark.parametrize("answer", ["", "{}", "[1, 2, 3]", '["one", 0, 0, 0, 0, 0, 1]', "[[0], 1]"])
def test_an_answer_that_is_no_pose_is_a_problem(kinematic: ScriptedRobot, answer: str) -> None:
    kinematic.show_arm(state="ENABLED")
    with trocar.arm("PSM1", kinematic.name) as psm:
        thread = reported(kinematic, lambda command: command.done(answer))
        with pytest.raises(trocar.Problem, match="which are not"):
            psm.forward_kinematics([0] * 6)
        thread.join()


def test_what_is_no_pose_is_not_sent(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED")
    with trocar.arm("PSM1", kinematic.name) as psm:
        for command in (psm.move_cp, psm.servo_cp, psm.servo_cr, psm.servo_cs, psm.set_base_frame):
            with pytest.raises(ValueError, match=r"transform|rotation"):
                command(2.0 * np.eye(4))
        for command in (psm.servo_cf, psm.body.servo_cf, psm.spatial.servo_cf):
            with pytest.raises(ValueError, match="6 numbers"):
                command([1.0, 2.0])
        assert not list(kinematic.mailbox.drain())


def test_an_arm_is_of_the_kind_that_is_asked_for(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    with trocar.psm("PSM1", kinematic.name) as psm:
        assert isinstance(psm, trocar.Psm)
    with pytest.raises(trocar.Problem, match="PSM1 is not of type MTM; its type is PSM"):
        trocar.mtm("PSM1", kinematic.name)
    with pytest.raises(trocar.Problem, match="no suj SUJ"):
        trocar.suj("SUJ", kinematic.name, timeout=0.0)


def test_a_system_lists_arms_and_processes(kinematic: ScriptedRobot) -> None:
    with trocar.system(kinematic.name) as system:
        assert system.arms() == ["PSM1"]
        assert {process.name for process in system.status()} == {"supervisor", "IO1", "PSM1"}


@pytest.mark.slow
def test_a_script_with_a_robot_ended_by_ctrl_c_says_so_in_one_line() -> None:
    code = "from trocar import arm\nprint('ready', flush=True)\narm('PSM1', 'nowhere', timeout=60)\n"
    script = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              text=True)
    assert script.stdout is not None and script.stdout.readline() == "ready\n"
    pause(0.2)
    script.send_signal(signal.SIGINT)
    _, errors = script.communicate(timeout=20)
    assert errors == "ended by Ctrl-C\n" and script.returncode == -signal.SIGINT  # as the shell sees it


@pytest.mark.slow
def test_an_import_changes_nothing_for_the_script() -> None:
    code = ("import sys\nbefore = sys.excepthook\nimport trocar\nfrom trocar import arm\n"
            "print(sys.excepthook is before, 'trocar.shm' in sys.modules)")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "True True\n"
    code = "import sys, trocar\nprint(*[name for name in sys.modules if name.startswith('trocar.')])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "\n"
