"""`trocar send COMPONENT COMMAND [ARGS]`: any command of the command tables."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from trocar.shm.mailbox.command_row import MOTION, CommandRow, of_type, row_of
from trocar.shm.mailbox.messages import Reply
from trocar.shm.memory.parts import parts_of
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import arm_type, document_of
from trocar.tools.output.errors import Misuse, Problem, only_waiting
from trocar.tools.output.printing import emit, table, tell
from trocar.tools.systems.find import chosen_system, unknown
from trocar.tools.verbs.options import JsonOption, SystemOption


def send(
    component: Annotated[str, typer.Argument(
        metavar="COMPONENT", help="Name of a process, e.g. PSM1, IO1, boards or supervisor.")],
    command: Annotated[str, typer.Argument(
        metavar="[COMMAND]", help="Name of the command; default: list all commands.")] = "",
    arguments: Annotated[list[str] | None, typer.Argument(
        metavar="[ARGS]...", help="Numbers and text that the command takes.")] = None,
    wait: Annotated[bool, typer.Option(
        "--wait", help="Wait until the command has finished, not only until it is accepted.")] = False,
    timeout: Annotated[float | None, typer.Option(
        "--timeout", min=0.0, help="Seconds to wait for the reply; default: 2, or 60 if --wait is given.")] = None,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Send a command to a process, and print the reply. Units are rad, m, s, N and N·m.

    Without COMMAND, all commands of the process are listed. An effort or wrench acts for only 0.1 s, unless it is sent
    again (key arm.effort_timeout_s). Exception: efforts or wrenches that are all zero act until the arm's next command.
    The arm then only compensates its weight, and can be moved by hand. A PSM takes one number for each joint: 6 with an
    instrument, 7 without.

    Example: trocar send PSM1 move_jp 0 0 0.12 0 0 0 --wait
    """
    name = chosen_system(system)
    owners = [instance for _, instance, what in parts_of(name) if what == "mailbox"]
    if component not in owners:
        raise unknown("component", component, owners)
    with Remote(name, component) as remote:
        if not command:
            return _listed(component, of_type(remote.commands, arm_type(name, component)), as_json)
        row, values, text = _checked(name, remote, command, arguments or [])
        stops = f"trocar send {component} hold" if row.move else "trocar power-off"
        with only_waiting(stops if row.effect_for(text, values) >= MOTION else ""):
            ask = remote.settled if wait else remote.answered
            reply = ask(command, values, text, timeout or (60.0 if wait else 2.0))
    if as_json:
        emit({"component": component, "command": command, "outcome": reply.outcome, "text": reply.text})
    else:
        _tell(component, row, reply)
    return 0 if reply.outcome in ("accepted", "done") else 1


def _tell(component: str, row: CommandRow, reply: Reply) -> None:
    """Print the reply; Problem if the command was refused or failed."""
    if reply.outcome not in ("accepted", "done"):
        reason = reply.text.removeprefix(f"{row.name}: ") or "no reason given"
        raise Problem(f"{component} {row.name} {reply.outcome}: {reason}")
    colon = ", " if row.move or row.stream else ": "  # done, clipped: insertion 5.000 → 0.240 m
    tell(reply.outcome + (f"{colon}{reply.text}" if reply.text else ""))


def _checked(system: str, remote: Remote, command: str, words: list[str]) -> tuple[CommandRow, list[float], str]:
    """The row of a command, and its numbers and text; Misuse if the component has no such command, or takes others."""
    component, known = remote.instance, {str(row["name"]): row for row in remote.commands}
    if command not in known:
        there = of_type(remote.commands, arm_type(system, component))
        raise unknown("command", command, [str(row["name"]) for row in there], component)
    values, text = parsed(known[command], words)
    if known[command].get("text") and not text and "" not in words and _is_users(system, component):
        raise Misuse(f"{command} takes {_takes(known[command])}; no text was given ('': an empty one)")
    return row_of(known[command]), values, text


def _is_users(system: str, component: str) -> bool:
    """Whether a component is a user's process, whose methods take every declared argument."""
    return any((row.name, row.kind) == (component, "user") for row in document_of(system).processes)


def _listed(component: str, rows: list[dict[str, Any]], as_json: bool) -> int:
    """Every command of a component with its text, its numbers and what it does."""
    if as_json:
        emit(*({"component": component, **row} for row in rows))
    else:
        cells = [(str(row["name"]), _takes(row).replace("|", " | "), str(row.get("doc", ""))) for row in rows]
        table("", ("command", "takes", "meaning"), cells)
    return 0


def parsed(row: dict[str, Any], words: list[str]) -> tuple[list[float], str]:
    """Numbers and text of a command from the words given, by its row of the table; Misuse says what it takes."""
    takes_values, takes_text = bool(row.get("values")), bool(row.get("text"))
    values, texts = [], []
    for word in words:
        number = _number(word) if takes_values else None
        if number is None:
            texts.append(word)
        else:
            values.append(number)
    if texts and not takes_text:
        raise Misuse(f"{row['name']} takes {_takes(row) or 'nothing'}, got {' '.join(texts)!r}")
    if why := row_of(row).objection(values):
        taken = f"; {' '.join(texts)!r} was taken as its text ({row['text']})" if takes_values and texts else ""
        raise Misuse(f"{row['name']}: {why}{taken}")
    return values, " ".join(texts)


def _takes(row: dict[str, Any]) -> str:
    """The numbers and the text of a command, as its row names them."""
    return " ".join(part for part in (str(row.get("values", "")), str(row.get("text", ""))) if part)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
