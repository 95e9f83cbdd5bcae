"""What the system answers; sounds, volume and everybody's messages."""

from __future__ import annotations

import io
import math
import wave
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io.harness import FakeCommand
from tests.whole.test_bring_up import FakeArm
from trocar.procs.system.message_hub import BEEP_NS, MessageHub, MessageSource
from trocar.procs.system.sound import GIVE_UP_NS, NO_PLAYER, Sound, tone
from trocar.procs.system.system_commands import SystemCommands
from trocar.procs.tables.code_row import Code
from trocar.shm.memory.layout import schema_of
from trocar.shm.system.events import SEVERITIES
from trocar.shm.topics import EVENTS


class FakeEvents:
    """Remembers what is reported."""

    def __init__(self) -> None:
        self.reported: list[tuple[str, str]] = []
        self.components: list[str] = []

    def emit(self, event: str, text: str = "", *, component: str = "", **_: object) -> None:
        self.reported.append((event, text))
        self.components.append(component)

    def status(self, text: str, component: str = "") -> None:
        self.reported.append(("status", text))

    def report(self, code: Code, text: str, *_: object, **__: object) -> None:
        self.reported.append((SEVERITIES[code.severity], text))


class FakeConsole:
    """A mailbox."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, tuple[float, ...]]] = []

    def send(self, name: str, values: tuple[float, ...] = (), text: str = "") -> int:
        self.sent.append((name, values))
        return 1

    def poll(self) -> list[object]:
        return []


class CommandStage:
    """The system's commands on fake arms, without programs for sounds."""

    def __init__(self, *arms: FakeArm) -> None:
        self.events, self.console, self.arms = FakeEvents(), FakeConsole(), arms
        self.sound = Sound(lambda name: None)
        events: Any = self.events
        consoles: Any = [self.console]
        self.commands = SystemCommands(arms, consoles, events, self.sound, 0.5, ["PSM1", "SUJ/PSM1"])

    def ask(self, name: str, *values: float, text: str = "") -> FakeCommand:
        command = FakeCommand(name, text, *values)
        self.commands.execute([command], 1)
        return command


def test_power_off_stops_teleoperation_first() -> None:
    stage = CommandStage(FakeArm("PSM1", "ENABLED"))
    command = stage.ask("power_off")
    assert stage.console.sent == [("teleop_enable", (0.0,))] and stage.arms[0].words == ["disable"]
    stage.arms[0].pass_time(1.0)
    stage.commands.execute([], 2)
    assert command.outcome == "done"


def test_power_off_ends_homing() -> None:
    stage = CommandStage(FakeArm("PSM1"))
    homing = stage.ask("home")
    off = stage.ask("power_off")
    assert homing.outcome == "failed" and "power_off" in homing.answers[-1][1] and off.outcome == "accepted"
    assert not [what for what, _ in stage.events.reported if what != "status"], "it was asked for: no error"


@pytest.mark.parametrize("goal", ["power_on", "home"])
def test_hold_ends_a_bring_up_and_nothing_more_is_sent_after_it(goal: str) -> None:
    stage = CommandStage(FakeArm("PSM1"))
    begun, held = stage.ask(goal), stage.ask("hold")
    assert begun.answers[-1] == ("failed", "hold was requested") and held.outcome == "done"
    assert stage.console.sent == [("teleop_enable", (0.0,))] and stage.arms[0].words == ["enable", "hold"]
    for _ in range(3):
        stage.arms[0].is_busy, stage.arms[0].state = False, "ENABLED"
        stage.commands.execute([], 2)
    assert stage.arms[0].words == ["enable", "hold"]


def test_hold_is_done_only_when_it_has_been_sent_to_each_arm_in_the_name_of_its_sender() -> None:
    stage = CommandStage(FakeArm("PSM1", "ENABLED"), FakeArm("PSM2", "ENABLED"))
    stage.arms[0].is_deaf = True
    held = stage.ask("hold")
    assert held.outcome == "accepted" and stage.arms[1].words == ["hold"]
    stage.arms[0].is_deaf = False
    stage.commands.execute([], 2)
    assert held.outcome == "done" and [arm.words for arm in stage.arms] == [["hold"]] * 2
    assert [arm.origins for arm in stage.arms] == [[held.origin]] * 2


def test_hold_does_not_end_a_power_off() -> None:
    stage = CommandStage(FakeArm("PSM1", "ENABLED"))
    off, _ = stage.ask("power_off"), stage.ask("hold")
    assert off.outcome == "accepted" and stage.arms[0].words == ["disable", "hold"]


def test_home_asked_again_while_arms_are_homed_ends_with_the_first_and_is_no_error() -> None:
    stage = CommandStage(FakeArm("PSM1", "ENABLED"))
    both = stage.ask("home"), stage.ask("home")
    assert [one.outcome for one in both] == ["accepted"] * 2
    stage.arms[0].pass_time(1.0)
    stage.commands.execute([], 2)
    assert [one.outcome for one in both] == ["done"] * 2
    assert not [what for what, _ in stage.events.reported if what != "status"]


def test_volume_is_clamped() -> None:
    stage = CommandStage()
    clipped = stage.ask("set_volume", 1.7)
    assert clipped.answers[-1] == ("done", "clipped: volume 1.7 → 1") and stage.commands.volume == 1.0
    assert ("volume", "") in stage.events.reported
    assert stage.ask("set_volume", math.nan).outcome == "refused" and stage.commands.volume == 1.0


@pytest.mark.parametrize("values", [(), (1.0, 2.0, 0.5, 1.0), (math.nan,), (0.3, math.inf)])
def test_senseless_beep_is_refused(values: tuple[float, ...]) -> None:
    assert CommandStage().ask("beep", *values).outcome == "refused"


def test_long_beep_is_clipped_with_a_warning() -> None:
    stage = CommandStage()
    (outcome, text), = stage.ask("beep", 100.0, 3000.0, 2.0).answers
    assert outcome == "done" and text.startswith("clipped: duration 100 → 60, volume 2 → 1; ") and "aplay" in text
    assert [event for event, _ in stage.events.reported] == ["warning", "warning", "beep"]


def test_computer_without_sound_says_so() -> None:
    sound = Sound(lambda name: None)
    sound.beep(0.3, 3000.0, 0.5)
    sound.say("hello", 0.5)
    assert sound.step(0) == "" and sound.name == NO_PLAYER and "aplay" in sound.lacks and "espeak" in sound.lacks


def test_beep_is_a_sine_of_its_frequency() -> None:
    with wave.open(io.BytesIO(tone(0.1, 1000.0, 0.5))) as file:
        samples = np.frombuffer(file.readframes(file.getnframes()), np.int16)
        rate = file.getframerate()
    assert len(samples) == round(0.1 * rate) and np.abs(samples).max() == pytest.approx(0.5 * 32767, rel=0.01)
    assert np.argmax(np.abs(np.fft.rfft(samples))) * rate / len(samples) == pytest.approx(1000.0, abs=10.0)


def test_errors_of_all_are_repeated_and_beep_every_two_seconds() -> None:
    record: Any = np.zeros(1, dtype=schema_of(EVENTS, {}).dtype)
    waiting: list[tuple[int, str]] = []

    class FakeCommandRing:
        def field(self, name: str) -> Any:
            return record[name].reshape(())

        def next(self) -> bool:
            if waiting:
                record["severity"], record["text"] = waiting.pop(0)
                return True
            return False

    events, beeps = FakeEvents(), []
    reported: Any = events
    centre = MessageHub([MessageSource("PSM1", FakeCommandRing())], reported, lambda: beeps.append(1))
    waiting += [(3, "a"), (0, "no message"), (3, "b"), (2, "c"), (1, "d")]
    centre.step(1)
    assert events.reported == [("error", "a"), ("error", "b"), ("warning", "c"), ("status", "d")]
    assert set(events.components) == {"PSM1"} and (centre.errors, centre.warnings, len(beeps)) == (2, 1, 1)
    waiting.append((3, "e"))
    centre.step(BEEP_NS)
    assert len(beeps) == 1
    waiting.append((3, "f"))
    centre.step(1 + BEEP_NS)
    assert len(beeps) == 2


def test_sounds_are_heard_one_after_the_other(tmp_path: Path) -> None:
    heard = tmp_path / "heard"
    programs = {}
    for name, line in (("aplay", "wc -c"), ("espeak", 'echo "$@"')):
        programs[name] = tmp_path / name
        programs[name].write_text(f"#!/bin/sh\n{line} >> {heard}\n")
        programs[name].chmod(0o755)
    sound = Sound(lambda name: str(programs[name]) if name in programs else None)
    assert sound.name == "aplay, espeak" and sound.lacks == ""
    sound.beep(0.1, 1000.0, 0.5)
    sound.say("hello", 0.5)
    sound.beep(0.1, 1000.0, 0.0)  # nothing to hear
    for _ in range(2):
        assert sound.step(0) == ""
        sound.finish()
    bytes_of_the_beep, words = heard.read_text().splitlines()
    assert int(bytes_of_the_beep) == len(tone(0.1, 1000.0, 0.5)) and words == "-a 100 -- hello"
    sound.close()


def test_player_that_cannot_be_started_is_told() -> None:
    sound = Sound(lambda name: f"/nowhere/{name}")
    sound.beep(0.1, 1000.0, 0.5)
    assert "cannot be started" in sound.step(0) and sound.step(0) == ""


def test_programs_are_those_of_the_path_and_what_they_fail_at_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert Sound().name == NO_PLAYER
    for name, line in (("paplay", "exit 3"), ("espeak-ng", "while :; do :; done")):
        (tmp_path / name).write_text(f"#!/bin/sh\n{line}\n")
        (tmp_path / name).chmod(0o755)
    sound = Sound()
    assert sound.name == "paplay, espeak-ng" and sound.lacks == ""
    reported = []
    for _ in range(2):
        sound.beep(0.1, 1000.0, 0.5)
        reported.append(sound.step(0))
        sound.finish()
        reported.append(sound.step(0))
    assert reported == ["", f"{tmp_path}/paplay ended with 3; the sound may not have been played", "", ""]
    sound.say("hello", 0.5)
    assert sound.step(0) == "" and sound.step(GIVE_UP_NS - 1) == ""
    assert "espeak-ng does not end" in sound.step(GIVE_UP_NS) and sound.step(GIVE_UP_NS) == ""
    sound.close()


def test_a_pose_is_shown_until_its_program_hides_it_or_ends() -> None:
    stage = CommandStage(FakeArm("PSM1", "ENABLED"))
    command = stage.ask("show_pose", 0.1, -0.2, text="PSM1")
    assert command.outcome == "done" and stage.commands.shown == ("PSM1", [0.1, -0.2])
    assert stage.ask("show_pose", 0.3, text="SUJ/PSM1").outcome == "done" and stage.commands.shown[0] == "SUJ/PSM1"
    for values, text, why in (((0.3,), "PSM7", "no arm PSM7"), ((0.0,) * 9, "PSM1", "1 to 8"), ((), "PSM1", "1 to 8")):
        assert why in stage.ask("show_pose", *values, text=text).answers[-1][1]
    assert stage.commands.shown == ("SUJ/PSM1", [0.3])
    assert stage.ask("show_pose").outcome == "done" and stage.commands.shown == ("", ())
    shows = stage.ask("show_pose", 0.3, text="PSM1")
    shows.has_client = False
    stage.commands.execute([], 3)
    assert stage.commands.shown == ("", ())
