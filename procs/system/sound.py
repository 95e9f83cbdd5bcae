"""Beeps and speech by programs installed on this computer; without them there is no sound.

Sounds are played in sequence, each in a process of its own, so that no loop ever waits for a loudspeaker.
"""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import wave
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

PLAYERS: Final = (("aplay", ("-q", "-")), ("paplay", ("/dev/stdin",)))
SPEAKERS: Final = ("espeak-ng", "espeak")
LOUDEST: Final = 200  # of espeak
RATE_HZ: Final = 22050
FADE_S: Final = 0.005  # without it a beep clicks
WAITING: Final = 8
GIVE_UP_NS: Final = 90_000_000_000  # the longest beep is 60 s; a program that takes longer hangs, and others wait
NO_PLAYER: Final = "none"
BEEPS, SPEECH = "beeps (aplay or paplay)", "speech (espeak-ng or espeak)"


def tone(duration_s: float, frequency_hz: float, volume: float) -> bytes:
    """A sine as a WAV file, 16 bit mono, of whole Hz: one second repeated, so that a minute takes a ms to compute."""
    times = np.arange(RATE_HZ) / RATE_HZ
    second = np.rint(np.sin(2.0 * np.pi * round(frequency_hz) * times) * volume * 32767.0)
    samples = np.resize(second.astype(np.int16), max(1, round(duration_s * RATE_HZ)))
    fade = np.minimum(times / FADE_S, 1.0)[: min(len(samples), round(FADE_S * RATE_HZ))]
    for edge in (samples[: len(fade)], samples[::-1][: len(fade)]):
        edge[...] = np.rint(edge * fade)
    file = io.BytesIO()
    with wave.open(file, "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(RATE_HZ)
        out.writeframes(samples.tobytes())
    return file.getvalue()


class Sound:
    """The queue of sounds, and the sound being played."""

    def __init__(self, find: Callable[[str], str | None] = shutil.which) -> None:
        """`find` gives the path of a program, or None if it is not installed."""
        self._player = next(((path, *words) for name, words in PLAYERS if (path := find(name))), None)
        self._speaker = next((path for name in SPEAKERS if (path := find(name))), None)
        self._waiting: deque[tuple[Sequence[str], bytes]] = deque(maxlen=WAITING)
        self._now: subprocess.Popen[bytes] | None = None
        self._begun_ns = 0
        self._failing: set[str] = set()  # programs that failed the last time, already reported

    @property
    def name(self) -> str:
        """The programs in use; "none" without any."""
        paths = [row for row in (self._player and self._player[0], self._speaker) if row]
        return ", ".join(Path(path).name for path in paths) or NO_PLAYER

    @property
    def lacks(self) -> str:
        """Sounds that cannot be played, with the missing programs; empty if all can."""
        return self.lacks_of(BEEPS, SPEECH)

    def lacks_of(self, *sounds: str) -> str:
        """The same, of these sounds."""
        there = {BEEPS: self._player, SPEECH: self._speaker}
        missing = [sound for sound in sounds if there[sound] is None]
        return f"no {' and no '.join(missing)} on this computer" if missing else ""

    def beep(self, duration_s: float, frequency_hz: float, volume: float) -> None:
        """Queue a beep."""
        if self._player is not None and volume > 0.0:
            self._waiting.append((self._player, tone(duration_s, frequency_hz, volume)))

    def say(self, text: str, volume: float) -> None:
        """Queue a sentence."""
        if self._speaker is not None and volume > 0.0:
            self._waiting.append(((self._speaker, "-a", str(round(LOUDEST * volume)), "--", text), b""))

    def step(self, now_ns: int) -> str:
        """Begin the next sound after the last has ended; returns a problem, or empty. `now_ns`: real time."""
        if self._now is not None:
            if self._now.poll() is None and now_ns - self._begun_ns < GIVE_UP_NS:
                return ""
            if problem := self._ended(self._now):
                return problem
        if not self._waiting:
            return ""
        command, content = self._waiting.popleft()
        self._begun_ns = now_ns
        try:
            file = os.memfd_create("sound")
            with os.fdopen(file, "wb") as sound:
                sound.write(content)
                sound.seek(0)
                self._now = subprocess.Popen(command, stdin=file, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        except OSError as error:
            return f"{command[0]} cannot be started: {error.strerror}"
        return ""

    def _ended(self, player: subprocess.Popen[bytes]) -> str:
        """The problem of a program that has ended, or would not end; reported once, until it succeeds again."""
        self._now = None
        command = str(player.args[0]) if isinstance(player.args, Sequence) else str(player.args)
        if player.poll() is None:
            player.kill()
            player.wait()
            why = "does not end"
        elif player.returncode == 0:
            self._failing.discard(command)
            return ""
        else:
            why = f"ended with {player.returncode}"
        if command in self._failing:
            return ""
        self._failing.add(command)
        return f"{command} {why}; the sound may not have been played"

    def finish(self) -> None:
        """Wait for the end of the sound being played; not for use in a loop."""
        if self._now is not None:
            self._now.wait()

    def close(self) -> None:
        """Stop the sound and clear the queue."""
        self._waiting.clear()
        if self._now is not None and self._now.poll() is None:
            self._now.kill()
            self._now.wait()
