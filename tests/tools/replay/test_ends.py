"""However a stream, a replay or repeated commands end, the arms are asked to hold; they do not go on when held up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.system.robot import ROOT
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.recordings import names
from trocar.procs.recordings.facts import facts_of
from trocar.procs.recordings.snapshot import take
from trocar.shm.mailbox.client import MailboxFull
from trocar.shm.time import system_time
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client import following
from trocar.tools.client.following import Follower, HeldUp, holding_at_end
from trocar.tools.client.remote import Remote
from trocar.tools.inspect import watch as watching
from trocar.tools.inspect.watch import Watch
from trocar.tools.output.errors import Problem
from trocar.tools.replay import live
from trocar.tools.replay.asking import RecordedMoves, send_again
from trocar.tools.replay.live import RecordedMotion
from trocar.tools.replay.recorded_commands import RecordedCommand
from trocar.tools.verbs.stream import stream

START, STEP_NS = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), 5_000_000
MOVE_S = 1.0


class PlayedArm:
    """PSM1 of a made-up system: moves take a second, and what is to happen happens while others wait."""

    def __init__(self, robot: ScriptedRobot, patch: pytest.MonkeyPatch) -> None:
        self.robot, self.now_ns, self.asked = robot, monotonic_ns(), list[str]()
        self.begin_ns = self.now_ns
        self.setpoint, self.state, self.moves_end, self.refuses = np.zeros(6), "ENABLED", True, ""
        self._under_way: list[tuple[int, Any]] = []
        self.happens: dict[float, Callable[[], None]] = {}
        for module in (following, watching, system_time):
            patch.setattr(module, "monotonic_ns", lambda: self.now_ns)
        patch.setattr(following, "boottime_ns", lambda: self.now_ns)
        for module in (following, system_time):
            patch.setattr(module, "pause", self.wait)
        self.show()

    @property
    def passed_s(self) -> float:
        return (self.now_ns - self.begin_ns) * 1e-9

    def show(self) -> None:
        self.robot.arm.field("setpoint_position")[:6] = self.setpoint
        self.robot.arm.field("jaw_setpoint_position")[...] = 0.0
        self.robot.show_arm(0.1, self.state, homed=True, age_s=(monotonic_ns() - self.now_ns) * 1e-9)

    def serve(self) -> None:
        for command in self.robot.mailbox.drain():
            self.asked.append(command.name)
            if self.refuses:
                command.refuse(self.refuses)
                continue
            if "move_" not in command.name:
                command.done()
                continue
            command.accept()
            if command.name == "move_jp":
                self.setpoint = np.array(command.values)
            self._under_way.append((self.now_ns + round(MOVE_S * 1e9), command))
        for end_ns, command in [*self._under_way]:
            if self.moves_end and self.now_ns >= end_ns:
                command.done()
                self._under_way.remove((end_ns, command))

    def wait(self, seconds: float) -> None:
        self.now_ns += max(round(seconds * 1e9), 1)
        for at_s in [at_s for at_s in self.happens if self.passed_s >= at_s]:
            self.happens.pop(at_s)()
        self.serve()
        self.show()

    # what may happen

    def interrupt(self) -> None:
        raise KeyboardInterrupt

    def fault(self) -> None:
        self.state = "FAULT"

    def pause_and_resume(self) -> None:
        for self.state in ("PAUSED", "ENABLED"):
            self.show()

    def stop_us(self) -> None:
        self.now_ns += 500_000_000


@pytest.fixture
def arm(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[PlayedArm]:
    with robot(world.name) as made:
        yield PlayedArm(made, monkeypatch)


def recorded(seconds: float) -> RecordedMotion:
    stamps = np.arange(0, round(seconds * 1e9), STEP_NS)
    rows = np.tile(START, (len(stamps), 1))
    return RecordedMotion("PSM1", stamps, rows, rows, np.zeros(len(stamps)))


def asked_at(*seconds: float) -> RecordedMoves:
    return RecordedMoves(tuple(RecordedCommand(
        "PSM1", "arm", round(at * 1e9), "move_jp", tuple(START + at / 100.0), "", 7, 0, "script", 1, k, 9, "accepted")
        for k, at in enumerate(seconds)), ())


def by_stream(arm: PlayedArm, folder: Path) -> None:
    np.savetxt(folder / "rows.csv", np.tile(np.append(START, 0.0), (1000, 1)), delimiter=",")
    stream("PSM1", folder / "rows.csv", 200.0, 0.0, True, arm.robot.name)


def by_replay(arm: PlayedArm, folder: Path) -> None:
    live.stream(arm.robot.name, [recorded(5.0)], 1.0, lambda text, done: None)


def by_commands(arm: PlayedArm, folder: Path) -> None:
    send_again(arm.robot.name, asked_at(1.0, 2.0, 4.5), [recorded(5.0)], 1.0, lambda text, done: None)


WAYS = pytest.mark.parametrize("way", [by_stream, by_replay, by_commands])


@pytest.mark.parametrize(("way", "at_s"), [(by_stream, 0.5), (by_stream, 3.5), (by_replay, 3.5), (by_commands, 0.5)])
@pytest.mark.parametrize(("accident", "said"), [
    ("interrupt", None), ("fault", "FAULT"), ("pause_and_resume", "PAUSED"), ("stop_us", "stalled")])
def test_whatever_ends_it_the_arm_is_asked_to_hold(arm: PlayedArm, tmp_path: Path, way: Any, at_s: float, accident: str,
                                                   said: str | None) -> None:
    arm.happens[at_s] = getattr(arm, accident)
    with pytest.raises(Problem if said else KeyboardInterrupt, match=said):
        way(arm, tmp_path)
    sent = len(arm.asked)
    arm.serve()
    late = arm.asked[sent:]
    if accident == "fault":  # it stands; what a person does with it from now on is not ours to pause
        assert "hold" not in late and len(late) <= 2, "at most what was on its way"
    else:
        assert late[-1:] == ["hold"] and len(late) <= 3, "at most what was on its way, then hold"
    assert arm.passed_s < at_s + 0.6


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("verb", ["stream", "replay"])
@pytest.mark.slow
def test_a_program_that_is_asked_to_end_while_an_arm_approaches_asks_it_to_hold(
        world: Any, tmp_path: Path, verb: str, number: signal.Signals) -> None:
    with robot(world.name) as made:
        command = [sys.executable, "-m", "trocar", *_words_of(verb, made, tmp_path), "--system", made.name]
        # whoever runs the tests may ignore SIGHUP (nohup), and then its programs do as well
        program = subprocess.Popen(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)},
                                   stderr=subprocess.PIPE, text=True,
                                   preexec_fn=lambda: signal.signal(number, signal.SIG_DFL))
        asked, end_ns = list[str](), monotonic_ns() + 30_000_000_000
        while "hold" not in asked and program.poll() is None and monotonic_ns() < end_ns:
            made.beat()
            made.show_arm(0.1, "ENABLED", homed=True, age_s=-600.0)  # fresh, however long we have no core
            for each in made.mailbox.drain():
                asked.append(each.name)
                each.accept()
                if each.name == "move_jp":
                    program.send_signal(number)
            pause(0.005)
        program.kill()
        _, said = program.communicate()
        asked += [each.name for each in made.mailbox.drain()]
    assert asked == ["move_jp", "hold"], said


def _words_of(verb: str, made: ScriptedRobot, folder: Path) -> list[str]:
    """What a person types, with the file that it is about."""
    if verb == "stream":
        np.savetxt(folder / "rows.csv", np.tile(np.append(START, 0.0), (1000, 1)), delimiter=",")
        return ["stream", "PSM1", str(folder / "rows.csv")]
    for _ in range(5):
        made.show_arm(0.1, "ENABLED", homed=True)
    with (folder / "one.mcap").open("xb", buffering=0) as stream:
        take(made.name, stream, facts_of(made.name, names.DUMP, "one"), [])
    return ["replay", str(folder / "one.mcap"), "--arms", "PSM1", "--real-robot"]


@WAYS
@pytest.mark.slow
def test_an_arm_that_does_not_get_there_is_asked_to_hold(arm: PlayedArm, tmp_path: Path, way: Any,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following, "APPROACH_S", 6.0)  # long enough for all that is looked at meanwhile
    arm.moves_end = False
    with pytest.raises(Problem, match="has not ended after 6 s"):
        way(arm, tmp_path)
    arm.serve()
    assert arm.asked == ["move_jp", "hold"]


def test_commands_come_with_the_times_between_them_and_the_last_is_waited_for(arm: PlayedArm) -> None:
    rows = send_again(arm.robot.name, asked_at(1.0, 2.0, 4.5), [recorded(5.0)], 1.0, lambda text, done: None)
    assert [row["outcome"] for row in rows] == ["done"] * 3
    assert 7.5 <= arm.passed_s < 7.7, "two approaches, 4.5 s and the last move"
    arm.serve()
    assert arm.asked == ["move_jp", "jaw/move_jp", *["move_jp"] * 3, "hold"]


def test_a_refused_command_ends_it(arm: PlayedArm) -> None:
    arm.happens[2.1] = lambda: setattr(arm, "refuses", "not now")
    with pytest.raises(Problem, match="PSM1 refused move_jp: not now"):
        send_again(arm.robot.name, asked_at(0.4), [recorded(5.0)], 1.0, lambda text, done: None)
    arm.serve()
    assert arm.asked == ["move_jp", "jaw/move_jp", "move_jp", "hold"]


def test_an_arm_that_another_program_has_moved_is_not_begun_with(arm: PlayedArm) -> None:
    with Watch(arm.robot.name, "PSM1") as watch, Remote(arm.robot.name, "PSM1") as remote:
        watch.look()
        follower = Follower(watch, remote, True, SystemTime(""))
        follower.approach(START, 0.0)
        follower.must_be_there()
        arm.setpoint = START + (0, 0, 0.002, 0, 0, 0)
        arm.show()
        with pytest.raises(Problem, match=r"another program has moved it from the starting pose \(insertion\)"):
            follower.must_be_there()


class SeenArm:
    """An arm's record."""

    def __init__(self, sub_state: str) -> None:
        self._sub_state = sub_state

    def look(self) -> bool:
        return True

    def text(self, field: str) -> str:
        return {"sub_state": self._sub_state}[field]


class DeafRemote:
    """A mailbox that cannot be written to, or one that can."""

    def __init__(self, instance: str, error: Exception | None = None) -> None:
        self.instance, self.asked, self._error = instance, list[str](), error

    def send(self, command: str) -> int:
        self.asked.append(command)
        if self._error is not None:
            raise self._error
        return 1


def test_each_arm_is_asked_to_hold_whatever_becomes_of_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    remotes: list[Any] = [DeafRemote("PSM1"), DeafRemote("PSM2", MailboxFull("no room")), DeafRemote("PSM3")]
    arms: list[Any] = [(SeenArm("HOMED"), remote) for remote in remotes]
    with pytest.raises(Problem, match=r"stalled for 2 s: the replay has ended"), holding_at_end(arms, "the replay"):
        raise HeldUp("stalled for 2 s")
    assert [remote.asked for remote in remotes] == [["hold"]] * 3
    assert "PSM2 could not be commanded to hold: no room" in capsys.readouterr().err


@pytest.mark.parametrize("state", ["MANUAL", "ENGAGING_TOOL", "HOMING", "PAUSED", "FAULT"])
def test_what_a_person_does_with_an_arm_is_not_paused_by_the_end_of_a_program(state: str) -> None:
    remote: Any = DeafRemote("PSM1")
    arm: Any = SeenArm(state)
    with holding_at_end([(arm, remote)], "the stream"):
        pass
    assert remote.asked == []
