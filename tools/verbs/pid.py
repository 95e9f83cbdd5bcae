"""`trocar pid show|set|save`: gains of the joint controllers while the robot runs, and back into a file."""

from __future__ import annotations

import getpass
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from trocar.procs.document.gains import BY_KEY, GAINS
from trocar.shm.mailbox.mailbox_map import MAX_TEXT
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.gains import ALL, Present, present
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import answer, counted, emit, note, table, tell
from trocar.tools.systems.find import chosen_system, unknown
from trocar.tools.verbs.options import JsonOption, SystemOption

CONFIRMED_NS: Final = 1_000_000_000
POLL_S: Final = 0.01
MAX_WHO: Final = 12  # letters of who asks

Robot = Annotated[str, typer.Argument(metavar="ROBOT", help="Robot or arm, e.g. PSM1.")]


def show(
    robots: Annotated[list[str] | None, typer.Argument(
        metavar="[ROBOT]...", help="Robots or arms; default: all.")] = None,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Print the gains in use for each axis. A star marks a value that differs from the PID file.

    Example: trocar pid show PSM1
    """
    for found in present(chosen_system(system), robots or []):
        if as_json:
            for axis, name in enumerate(found.names):
                emit({"robot": found.robot, "io": found.io, "axis": axis, "name": name, **found.row(axis),
                      "changed": found.changed(axis), "file": found.file})
            continue
        columns = ("", *(f"{axis} {name}" for axis, name in enumerate(found.names)))
        rows = [(gain.key, *(_cell(found, axis, gain.key) for axis in range(len(found.names)))) for gain in GAINS]
        table(f"{found.robot}: {found.file or 'no file'}", columns, rows, columns[1:])
    return 0


def _cell(found: Present, axis: int, key: str) -> str:
    value, star = found.row(axis)[key], "*" if key in found.changed(axis) else ""
    return f"{value:.9g}{star}" if not BY_KEY[key].switch else f"{'on' if value else 'off'}{star}"


def set_gains(
    robot: Robot,
    axis: Annotated[str, typer.Argument(metavar="AXIS", help="Number (from 0) or name of an axis, or all.")],
    gains: Annotated[list[str], typer.Argument(metavar="KEY=VALUE...", help="As in PID files: p_gain=6 d_gain=0.1.")],
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Change gains of a running joint controller: all of them in the same I/O cycle, or none. The arm may move!

    Example: trocar pid set PSM1 3 p_gain=6.5 d_gain=0.1
    """
    pairs = [_pair(text) for text in gains]
    name = chosen_system(system)
    found = present(name, [robot])[0]
    place = found.axis(axis)
    text = " ".join([found.robot, *(key for key, _ in pairs), f"@{getpass.getuser()[:MAX_WHO]}"])
    if len(text.encode()) > MAX_TEXT:
        raise Misuse(f"too much for one command ({len(text.encode())} bytes of names; allowed: {MAX_TEXT}); "
                     "give fewer gains at once")
    with Remote(name, found.io) as remote:
        reply = remote.settled("set_gains", [place, *(value for _, value in pairs)], text, 5.0)
    if reply.outcome != "done":
        raise Problem(f"{found.robot}: {reply.text or reply.outcome}")
    if reply.text:  # the joint controller is off, and will not be switched on with these
        note(f"{found.robot}: {reply.text}")
    places = list(range(len(found.names))) if place == ALL else [place]
    _confirm(name, found.robot, places, pairs)
    for number in places:
        old = found.row(number)
        steps = ", ".join(f"{key} {old[key]:.9g} → {value:.9g}" for key, value in pairs)
        answer({"robot": found.robot, "axis": number, "name": found.names[number],
                "old": {key: old[key] for key, _ in pairs}, "new": dict(pairs)},
               f"{found.robot} axis {number} {found.names[number]}: {steps}", as_json)
    return 0


def _confirm(system: str, robot: str, places: list[int], pairs: list[tuple[str, float]]) -> None:
    """Make sure that io shows the gains it was asked for; Problem when it does not."""
    end = monotonic_ns() + CONFIRMED_NS
    while True:
        now = present(system, [robot])[0]
        others = [f"{now.names[place]} {key} {now.row(place)[key]:.9g}" for place in places for key, value in pairs
                  if now.row(place)[key] != value]
        if not others:
            return
        if monotonic_ns() >= end:
            raise Problem(f"{robot}: {now.io} answered done, but reports other gains: {', '.join(others)}")
        pause(POLL_S)


def _pair(text: str) -> tuple[str, float]:
    key, equals, value = text.partition("=")
    if not equals:
        raise Misuse(f"{text!r}: KEY=VALUE is needed, e.g. p_gain=6.5")
    if key not in BY_KEY:
        raise unknown("gain", key, BY_KEY)
    try:
        number = {"true": 1.0, "on": 1.0, "false": 0.0, "off": 0.0}.get(value.lower())
        return key, float(value) if number is None or not BY_KEY[key].switch else number
    except ValueError:
        raise Misuse(f"{key}={value}: a number is needed") from None


def save(
    robot: Robot,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="New file, NAME.json.")],
    force: Annotated[bool, typer.Option("--force", help="Overwrite FILE; its old content is kept beside it.")] = False,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Save the gains in use as a PID file for dVRK 2.4. Other keys in the original file are kept.

    To use FILE from the next start on, name it in the system file (`PID_file`).

    Example: trocar pid save PSM1 sawControllersPID-PSM1-tuned.json
    """
    from trocar.tools.verbs.pid_file import save_as  # loads all that reads configuration files

    found = present(chosen_system(system), [robot])[0]
    saved = save_as(found, file, force=force)
    if as_json:
        row: dict[str, Any] = {"robot": found.robot, "io": found.io, "file": found.file, "saved": str(file),
                               "changed": saved.changed, "backup": str(saved.backup or ""), "notes": saved.notes}
        emit(row)
        return 0
    differ = f"differs in {counted(len(saved.changed), 'value')} from {found.file or 'nothing'}"
    tell(f"{file}: {differ}" + (f": {', '.join(saved.changed)}" if saved.changed else ""))
    for text in saved.notes:
        note(text)
    return 0
