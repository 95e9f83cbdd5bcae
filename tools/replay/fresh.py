"""Repetition of a recorded run from its beginning: the same system, the same commands at the same instants.

Simulated time is held back (shm/time/held_time.py): it runs to just before the instant at which an owner took a
command, the command is put into its mailbox, and time resumes. So the result does not depend on the speed of this
machine, and is the same bit for bit.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count, groupby
from pathlib import Path
from typing import Final

from trocar.procs.node.pacing import AFTER_OTHERS_NS
from trocar.procs.recordings.reading import RecordedTopic, RecordingReader
from trocar.shm.mailbox.origins import Origin
from trocar.shm.mailbox.place import Place, take_place
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.held_time import HeldTime
from trocar.shm.time.lockstep import EPOCH_NS
from trocar.tools.analysis.choosing import TIMED, spans
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say, note
from trocar.tools.replay.configuration import recorded_system, startable
from trocar.tools.replay.recorded_commands import AUDIT, RecordedCommand, commands_of
from trocar.tools.replay.rings import WholeRings, new_file
from trocar.tools.systems.cleanup import own_folder
from trocar.tools.systems.supervising import Background, StartRequest

TAKEN_EVERY_NS: Final = 100_000_000
STANDS_S: Final = 30.0


@dataclass(slots=True)
class FreshRun:
    """Result: the new recording, the number of commands sent, and the parts that could not be repeated, in words."""

    file: Path
    commands: int = 0
    simulated_s: float = 0.0
    real_s: float = 0.0
    notes: list[str] = field(default_factory=list)


def run_again(recording: RecordingReader, file: Path, system: str, say: Say) -> FreshRun:
    """Start the recorded system as `system`, repeat its commands, record everything in the new `file`, and stop it.

    Problem: it is a real robot, lacks commands, or the system does not come up or crashes.
    """
    document, out = startable(recorded_system(recording))
    commands, notes = _repeatable(recording, out)
    for text in notes:
        note(text)  # before the run: it may take long
    end_ns = _end_ns(recording)
    run = FreshRun(file, notes=notes)
    with own_folder(system) as folder:
        frozen = folder / "document.json"
        frozen.write_bytes(document)
        background = Background(StartRequest(frozen, system, document=True, held=True), tied=True)
        try:
            background.wait_until_up(say)
            with HeldTime(system) as held:  # until then it stays at its beginning, however late we are
                if held.now_ns() != EPOCH_NS:
                    raise Problem(f"the time of {system} had begun before it was held")
                with new_file(file) as stream, WholeRings(system, stream, file.stem) as rings:
                    _play(held, system, rings, commands, end_ns, run, say)
                    lost = [f"{count} records of {topic} were lost" for topic, count in rings.lost.items()]
                    for text in lost:
                        note(text)
                    run.notes += lost
        except SegmentError as error:
            raise Problem(str(error)) from None
        except OSError as error:
            raise Problem(f"{file}: {error.strerror}") from None
        finally:
            background.stop(say)
    return run


def _repeatable(recording: RecordingReader, out: Sequence[str]) -> tuple[list[RecordedCommand], list[str]]:
    """The commands to send, and the expected differences from the recording; Problem if commands are missing."""
    rows = [recording.topics[name] for name in recording.record_topics]
    _check_complete(recording, rows, out)
    commands = [each for each in commands_of(recording) if each.instance not in out]
    return ([each for each in commands if each.kind in TIMED],
            [*(f"{name} is left out: time does not wait for it; its commands are repeated" for name in out),
             *_differences(recording, rows, commands)])


def _differences(recording: RecordingReader, rows: Sequence[RecordedTopic],
                 commands: Sequence[RecordedCommand]) -> Iterator[str]:
    """Why the new run will differ from the recording, in words."""
    if others := sorted({f"{each.instance} {each.name}" for each in commands if each.kind not in TIMED}):
        yield f"not repeated, since time does not wait for them: {', '.join(others)}"
    # epochs count successive writers; 0 is that of a ring not written yet
    if again := sorted({row.instance for row in rows if row.kind in TIMED
                         and len({*row.channels.values()} - {0}) > 1}):
        yield f"{', '.join(again)} was started again in it, which is not repeated"
    is_paced = recording.metadata.get("trocar", {}).get("clock") == "paced"
    if is_paced and any(each.kind in TIMED and each.streams for each in commands):
        yield ("the new run will differ: of streams (servo_…) a recording of a paced system has the first goal only; "
               "with --clock lockstep it has all")


def _check_complete(recording: RecordingReader, rows: Sequence[RecordedTopic], out: Sequence[str]) -> None:
    """Problem if the recording lacks a command to a process that simulated time waits for."""
    states = {row.instance for row in rows if row.ring == "state" and row.kind in TIMED}
    numbers = {row.instance: recording.records(row.name).rows["sequence"].tolist() for row in rows if row.ring == AUDIT}
    if missing := sorted(states - set(numbers)):
        raise Problem(f"commands to {', '.join(missing)} are not in it; record all topics")
    for instance, asked in ((instance, asked) for instance, asked in numbers.items() if asked):
        if instance not in out and asked[0] > 1:
            raise Problem(f"it begins after {asked[0] - 1} commands to {instance}: a run can be repeated from its "
                          "beginning only")
        if asked[-1] - asked[0] + 1 != len(asked):
            raise Problem(f"commands to {instance} are missing in it")


def _end_ns(recording: RecordingReader) -> int:
    """The last instant of a process that simulated time waits for."""
    topics = [name for name in recording.record_topics if recording.topics[name].kind in TIMED]
    last = max((last for _, last in spans(recording, topics).values()), default=0)
    if not EPOCH_NS <= last < EPOCH_NS + (1 << 55):
        raise Problem("it has no records of simulated time")
    return last


class _Sender:
    """Puts commands into mailboxes: through as many places as in the recording, with their persons' origins."""

    def __init__(self, system: str, commands: Sequence[RecordedCommand], held: HeldTime) -> None:
        self._held, self._numbers, self._count = held, dict[int, int](), count(1)
        self._places: dict[tuple[str, int], Place] = {}
        for key in sorted({(each.instance, each.place) for each in commands}):
            self._places[key] = take_place(system, key[0], "trocar replay")

    def send(self, command: RecordedCommand) -> None:
        """Just before its instant; wakes the owner if it does not look by itself then."""
        if command.origin not in self._numbers:
            self._numbers[command.origin] = os.getpid() << 32 | next(self._count) if command.origin else 0
        number = self._numbers[command.origin]
        origin = Origin(number, command.generation, command.program)
        self._places[command.instance, command.place].send(command.name, command.values, command.text, origin,
                                                           command.peer,
                                                           self._held.wake_ns(command.instance) != command.instant_ns)

    def close(self) -> None:
        for place in self._places.values():
            place.close()


def _play(held: HeldTime, system: str, rings: WholeRings, commands: Sequence[RecordedCommand], end_ns: int,
          run: FreshRun, say: Say) -> None:
    sender, taken_ns, begin, whole_ns = _Sender(system, commands, held), EPOCH_NS, monotonic_ns(), end_ns - EPOCH_NS

    def go_to(time_ns: int) -> None:
        nonlocal taken_ns
        until = 0
        while until < time_ns:
            until = min(time_ns, taken_ns + TAKEN_EVERY_NS)
            if not held.run_until(until, STANDS_S):
                raise Problem(f"the time of {system} stands still for {STANDS_S:g} s; trocar logs has more")
            if until == taken_ns + TAKEN_EVERY_NS:
                rings.take()
                taken_ns, done_ns = until, until - EPOCH_NS
                say(f"{done_ns * 1e-9:.1f} s of {whole_ns * 1e-9:.1f} s", done_ns / max(1, whole_ns))

    try:
        for instant, group in groupby(commands, key=lambda each: each.instant_ns):
            go_to(instant - AFTER_OTHERS_NS)
            for command in group:
                sender.send(command)
        go_to(end_ns)
        rings.take()
    except KeyError as error:
        raise Problem(f"the system has no {error}; it was recorded by another version") from None
    finally:
        sender.close()
    run.commands, run.simulated_s, run.real_s = len(commands), whole_ns * 1e-9, (monotonic_ns() - begin) * 1e-9
