"""`trocar replay FILE`: what was recorded once more, in a running system, to look at, or from its beginning."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from trocar.procs.machine.end_signals import ended_as_by_ctrl_c
from trocar.procs.recordings.reading import RecordingReader
from trocar.tools.analysis.choosing import FromOption, Stretch, ToOption, TopicsOption, chosen_topics, opened, stretch
from trocar.tools.analysis.comparing import DIFFERENT, Comparing, as_dict
from trocar.tools.analysis.differences import STAMP
from trocar.tools.inspect.watch import arm_names
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import Say, answer, emit, note, number, progress, table, tell
from trocar.tools.replay import asking, live
from trocar.tools.replay.fresh import run_again
from trocar.tools.replay.shown import Showing
from trocar.tools.systems.find import chosen_system
from trocar.tools.verbs.compare import show
from trocar.tools.verbs.options import JsonOption, SystemOption

SPEEDS = 0.01, 100.0


@ended_as_by_ctrl_c()
def replay(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording to replay.")],
    arms: Annotated[list[str] | None, typer.Option(
        "--arms", metavar="ARM", help="Arm to replay; repeatable; default: all.")] = None,
    commands: Annotated[bool, typer.Option(
        "--commands", help="Send the recorded motion commands instead of the setpoints.")] = False,
    name: Annotated[str, typer.Option(
        "--as", metavar="NAME", help="Name of a read-only system that shows the records.")] = "",
    fresh: Annotated[bool, typer.Option(
        "--fresh", help="Repeat the recorded run in a new system, and compare.")] = False,
    into: Annotated[Path | None, typer.Option(
        "--into", metavar="FILE.mcap", help="File for the new run; only with --fresh.")] = None,
    speed: Annotated[float, typer.Option("--speed", help="Speed factor: 0.5 takes twice as long.")] = 1.0,
    topics: TopicsOption = None,
    begin: FromOption = 0.0,
    end: ToOption = None,
    real: Annotated[bool, typer.Option("--real-robot", help="Permit motion of a real robot.")] = False,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Replay a recording in one of three ways: move arms, show the records, or repeat the run.

    Move arms, the default: homed arms of a running system move slowly to the start of the recording. They then follow
    the recorded setpoints at the recorded speed; with --commands, recorded commands such as move_jp are sent instead. A
    real robot needs --real-robot. Ctrl-C, or an arm in FAULT, ends the replay; the arms that are not in FAULT then
    hold.

    Show the records: --as NAME starts a read-only system NAME. `trocar list`, `trocar echo`, `trocar scope` and the
    bridges can read it.

    Repeat the run: with --fresh, a new system repeats the run from its start, and every bit is compared with the
    recording. The recorded run must have used simulated time. Exit code 1: the runs differ.

    Example: trocar replay monday.mcap --arms PSM1 --speed 0.5

    Example: trocar replay monday.mcap --as monday

    Example: trocar replay monday.mcap --fresh --into again.mcap
    """
    if not SPEEDS[0] <= speed <= SPEEDS[1]:
        raise Misuse(f"--speed {speed:g}: allowed are {SPEEDS[0]:g} to {SPEEDS[1]:g}")
    if sum((fresh, bool(name), commands)) > 1:
        raise Misuse("cannot combine --fresh, --as and --commands")
    if fresh:
        return _fresh(file, into, as_json)
    with opened(file) as recording, progress(f"replay {file.name}") as say:
        part = stretch(recording, begin, end)
        if name:
            return _shown(name, recording, chosen_topics(recording.record_topics, topics), part, speed, say, as_json)
        options = LiveOptions(chosen_system(system), arms, speed, commands, real)
        rows = options.run(recording, part, say)
    for row in rows:
        if as_json:
            emit(row)
        elif commands:
            said = " ".join(filter(None, [row["command"], row["text"], *(f"{value:g}" for value in row["values"])]))
            tell(f"{row['arm']}: {said}: {row['outcome']} {row['reply']}".rstrip())
        else:
            _show_tracking(row)
    refused = [f"{row['arm']} refused {row['refused']} goals: {row['refusal']}" for row in rows if row.get("refused")]
    if refused:
        raise Problem("; ".join(refused))
    return 0


def _shown(name: str, recording: RecordingReader, topics: Sequence[str], part: Stretch, speed: float, say: Say,
           as_json: bool) -> int:
    with Showing(name, recording, topics, part) as showing:
        note(f"shown as system {name}: trocar list --system {name}; Ctrl-C ends it")
        try:
            shown = showing.play(speed, say)
        except KeyboardInterrupt:
            return 0
    answer({"system": name, "records": shown}, f"{shown} records shown", as_json)
    return 0


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """A replay in a running system: its arms (None: all), speed, moves instead of setpoints, real robots allowed."""

    system: str
    arms: Sequence[str] | None
    speed: float
    commands: bool
    real: bool

    def run(self, recording: RecordingReader, part: Stretch, say: Say) -> list[dict[str, Any]]:
        """The results, a row for each arm or command; Problem if the recording has no arm of the system."""
        motions, left_out = live.motions_of(recording, arm_names(self.system, self.arms), part)
        if left_out and (self.arms or not motions):
            raise Problem("; ".join(left_out.values()))
        if left_out:
            note(f"left out, because not recorded or not homed: {', '.join(left_out)}")
        if not motions:
            raise Problem(f"{recording.path.name} has no arm of system {self.system}")
        live.refuse_real(self.system, [motion.arm for motion in motions], self.real)
        if not self.commands:
            return live.stream(self.system, motions, self.speed, say)
        moves = asking.moves_of(recording, motions)
        for text in moves.left_out:
            note(text)
        return asking.send_again(self.system, moves, motions, self.speed, say)


def _show_tracking(row: dict[str, Any]) -> None:
    """How far an arm was from what it was sent, and from where it was when that was recorded."""
    cells = []
    for k, joint in enumerate(row["names"]):
        then = [row[key][k] if k < len(row[key]) else None for key in ("recorded_rms", "recorded_max")]
        cells.append((joint, *(number(value, ".5f") for value in (row["rms"][k], row["max"][k], *then))))
    table(f"{row['arm']}: measured minus sent, and minus what was measured when it was recorded; rad, m",
          ("joint", "RMS", "largest", "recorded RMS", "recorded largest"), cells,
          ("RMS", "largest", "recorded RMS", "recorded largest"))


def _fresh(file: Path, into: Path | None, as_json: bool) -> int:
    again = into or file.with_name(f"{file.stem}-again.mcap")
    if again.exists():
        raise Misuse(f"{again} is there already; --into names another file")
    with opened(file) as recording, progress(f"replay {file.name}") as say:
        run = run_again(recording, again, f"replay{os.getpid()}", say)
        with opened(again) as other:
            found = Comparing(STAMP, common=True, as_a=True).of(recording, other, say=say)
    if as_json:
        emit({"file": str(run.file), "commands": run.commands, "simulated_s": run.simulated_s, "real_s": run.real_s,
              "notes": run.notes, "difference": as_dict(found)})
    else:
        tell(f"{run.file}: {run.commands} commands in {run.simulated_s:.1f} s of simulated time, {run.real_s:.1f} s")
        show(found)
    return 1 if found.outcome == DIFFERENT else 0
