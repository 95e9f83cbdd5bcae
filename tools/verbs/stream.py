"""`trocar stream ARM FILE`: joint setpoints from a CSV, and how well the arm followed them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from trocar.procs.document.system import Tool
from trocar.procs.machine.end_signals import ended_as_by_ctrl_c
from trocar.procs.machine.paths import given_file, not_found
from trocar.shm.mailbox.client import begin
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.following import MAX_GAP_S, Follower, beats, holding_at_end
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import Watch, arm_names, tool_on
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import Say, emit, note, progress, table, tell
from trocar.tools.systems.find import chosen_system
from trocar.tools.verbs.options import JsonOption, SystemOption
from trocar.tools.verbs.setpoints import ClippedRows, Setpoints, clipped, read_setpoints

SHOWN_EVERY = 20


@ended_as_by_ctrl_c()
def stream(
    arm: Annotated[str, typer.Argument(metavar="ARM", help="A homed arm.")],
    file: Annotated[Path, typer.Argument(
        metavar="FILE", help="CSV; each row has positions of all joints and the jaw, "
        "then optionally their velocities, then their efforts; rad, m.")],
    rate: Annotated[float, typer.Option("--rate", min=1.0, max=1500.0, help="Rows a second.")] = 200.0,
    seconds: Annotated[float, typer.Option(
        "--for", min=0.0, help="Stop after this many seconds of the system's time; 0: all rows.")] = 0.0,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Move to the file's first row, then follow its rows at a steady rate; prints the tracking error of each joint.

    If this program is delayed for more than 0.1 s, the stream ends and the arm holds.

    Example: trocar stream PSM1 recorded.csv --rate 200 --for 10
    """
    name = chosen_system(system)
    given = given_file(file)
    if not given.is_file():
        raise Misuse(f"{file}: {not_found(file)}")
    arm_names(name, [arm])
    with (SystemTime(name) as time, Watch(name, arm) as watch, Remote(name, arm) as remote,
          progress(f"stream {file.name}") as say):
        if not watch.look() or watch.state != "ENABLED" or not watch.homed:
            raise Problem(f"{arm} is not homed; first: trocar home {arm}")
        has_jaw = watch.flag("has_jaw")
        rows, cut, notes = _fitted(arm, read_setpoints(given, watch.count, has_jaw), has_jaw, tool_on(name, watch))
        for text in notes:
            note(text)
        remote.on_behalf(begin(name))  # the move to the first row and the stream are one command
        follower = Follower(watch, remote, rows.jaw is not None, time)
        count = len(rows) if not seconds else min(len(rows), round(seconds * rate))
        with holding_at_end([(watch, remote)], "the stream"):
            say("moving to the first row", None)
            follower.approach(rows.position[0], None if rows.jaw is None else float(rows.jaw[0]))
            follower.must_be_there()
            skipped = _follow(follower, rows, rate, count, time, say)
    result = _result(arm, follower, rate, count, skipped, cut)
    emit(result) if as_json else _show(result, follower)
    if follower.refused:
        raise Problem(f"{arm} refused {follower.refused} commands: {follower.refusal}")
    return 0


def _fitted(
    arm: str, rows: Setpoints, has_jaw: bool, tool: Tool | None
) -> tuple[Setpoints, ClippedRows | None, list[str]]:
    """Rows with the jaw brought into the instrument's range, and what a person should know about it."""
    if rows.jaw is None:
        return rows, None, [f"{arm}: the file has no jaw column; the jaw does not move"] if has_jaw else []
    if not has_jaw:
        return Setpoints(rows.position, rows.velocity, None), None, [f"{arm} has no jaw: the last column is left out"]
    if tool is None:
        return rows, None, [f"{arm}: the range of its jaw is not known; the arm clips by itself"]
    jaw, cut = clipped(rows.jaw, tool.jaw.lower, tool.jaw.upper)
    reported = []
    if cut.rows:
        reported.append(f"{arm}: the jaw leaves the range {tool.jaw.lower:.4f} to {tool.jaw.upper:.4f} rad of "
                        f"{tool.name} "
                        f"in {cut.rows} of {len(rows)} rows, by at most {cut.most:.4f} rad; clipped")
    return Setpoints(rows.position, rows.velocity, jaw), cut, reported


def _follow(follower: Follower, rows: Setpoints, rate: float, count: int, time: SystemTime, say: Say) -> int:
    """Send the rows; returns how many were skipped because their time had passed. HeldUp after too long a gap."""
    skipped = [0]
    for k in beats(rate, count, skipped, MAX_GAP_S, time):
        follower.collect()
        follower.send(rows.position[k], rows.velocity[k] if rows.velocity is not None else None,
                      float(rows.jaw[k]) if rows.jaw is not None else None)
        if k % SHOWN_EVERY == 0:
            say(f"row {k} of {count}", k / count)
    follower.collect()
    return skipped[0]


def _result(
    arm: str, follower: Follower, rate: float, count: int, skipped: int, cut: ClippedRows | None
) -> dict[str, Any]:
    tracking = follower.tracking
    return {
        "arm": arm, "rows": count, "rate_hz": rate, "skipped_rows": skipped, "samples": tracking.samples,
        "names": list(tracking.names), "rms": tracking.rms.tolist(), "max": tracking.most.tolist(),
        "jaw_clipped_rows": cut.rows if cut is not None else 0,
        "jaw_clipped_most": cut.most if cut is not None else 0.0,
        "clipped_by_arm": follower.clipped_by_arm, "refused": follower.refused,
    }


def _show(result: dict[str, Any], follower: Follower) -> None:
    columns = zip(result["names"], result["rms"], result["max"], strict=True)
    rows = [(name, f"{rms:.5f}", f"{most:.5f}") for name, rms, most in columns]
    title = f"{result['arm']}: {result['rows']} rows at {result['rate_hz']:g} Hz, {result['skipped_rows']} skipped"
    table(title, ("joint", "RMS error rad|m", "largest"), rows, right=("RMS error rad|m", "largest"))
    if follower.clipped_by_arm:
        tell(f"{follower.clipped_by_arm} setpoints were clipped by the arm to its joint limits")
