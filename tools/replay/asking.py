"""Repetition of the recorded commands to arms, with the times between them: moves and holds, nothing else.

Like a stream of setpoints it is a command of the person who types it (tools/replay/live.py).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from trocar.procs.recordings.reading import RecordingReader
from trocar.shm.commands import COMMANDS, ENDINGS
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.following import APPROACH_S, first_reply, waited
from trocar.tools.output.errors import Problem, Refused
from trocar.tools.output.printing import Say
from trocar.tools.replay.live import RecordedMotion, all_homed, at_the_start
from trocar.tools.replay.recorded_commands import RecordedCommand, commands_of

ROWS: Final = {row.name: row for row in COMMANDS["arm"]}
REPLY_S: Final = 5.0
ANSWERS: Final = ("accepted", *ENDINGS)


@dataclass(frozen=True, slots=True)
class RecordedMoves:
    """The commands to repeat, in their order, and the omissions, in words."""

    commands: tuple[RecordedCommand, ...]
    left_out: tuple[str, ...]


def moves_of(recording: RecordingReader, motions: Sequence[RecordedMotion]) -> RecordedMoves:
    """Commands of persons to arms while all of them were homed; Problem: none that can be repeated."""
    start, end = all_homed(motions)
    arms = [motion.arm for motion in motions]
    asked = [each for each in commands_of(recording) if each.instance in arms and each.outcome != "refused"]
    taken = tuple(each for each in asked if _is_asked_again(each.name) and start <= each.instant_ns <= end)
    left_out = tuple(_left_out(asked, start, end))
    if not taken:
        raise Problem("; ".join((f"there is no move of {', '.join(arms)} while homed, in this part of "
                                 f"{recording.path.name}", *left_out)))
    return RecordedMoves(taken, left_out)


def _is_asked_again(name: str) -> bool:
    """Whether a command is a move, or stops one. All others change an arm's configuration or power, release it, or are
    goals of a stream.
    """
    row = ROWS.get(name)
    return row is not None and (row.move or row.is_stop("", ()))


def _left_out(asked: Sequence[RecordedCommand], start: int, end: int) -> Iterator[str]:
    outside = Counter(each.instance for each in asked if not start <= each.instant_ns <= end)
    for arm, count in outside.items():
        yield f"left out: {count} commands to {arm} outside the time in which all arms are homed"
    others = Counter((each.instance, each.name) for each in asked
                     if not _is_asked_again(each.name) and start <= each.instant_ns <= end)
    for (arm, name), count in others.items():
        yield f"left out: {count} times {name} to {arm}, which is not a move"


def send_again(system: str, moves: RecordedMoves, motions: Sequence[RecordedMotion], speed: float, say: Say
               ) -> list[dict[str, Any]]:
    """Repeat the commands, with the times between them; returns their outcomes. Problem if an arm faults or refuses."""
    results, numbers = list[dict[str, Any]](), list[int]()
    recorded_ns = all_homed(motions)[0]
    with at_the_start(system, motions, recorded_ns, say) as (arms, time):
        remotes, followers = {arm.motion.arm: arm.remote for arm in arms}, [arm.follower for arm in arms]
        start_ns = time.now_ns()
        for done, command in enumerate(moves.commands):
            say(f"{command.instance} {command.name}", done / len(moves.commands))
            due_ns = start_ns + round((command.instant_ns - recorded_ns) / speed)
            waited(partial(_is_due, due_ns, time), followers, time)
            remote = remotes[command.instance]
            numbers.append(remote.send(command.name, command.values, command.text))
            reply = first_reply(remote, numbers[-1], ANSWERS, REPLY_S, followers, time)
            if reply.outcome == "refused":
                raise Refused(f"{command.instance} refused {command.name}: {reply.text}")
            results.append({"arm": command.instance, "command": command.name, "values": list(command.values),
                            "text": command.text, "outcome": reply.outcome, "reply": reply.text})
        say("the last moves", None)
        for row, number in zip(results, numbers, strict=True):
            if row["outcome"] not in ENDINGS:
                reply = first_reply(remotes[row["arm"]], number, ENDINGS, APPROACH_S, followers, time)
                row |= {"outcome": reply.outcome, "reply": reply.text}
    return results


def _is_due(due_ns: int, time: SystemTime) -> bool:
    return time.now_ns() >= due_ns
