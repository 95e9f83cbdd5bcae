"""`trocar send COMPONENT COMMAND [ARGS]`: any command of the command tables."""

from __future__ import annotations

from typing import Annotated, Any, Final

import typer

from trocar.shm.mailbox.command_row import MOTION, of_type, row_of
from trocar.shm.memory.segment import names_of
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import arm_type, document_of
from trocar.tools.output.errors import Misuse, Problem, only_waiting
from trocar.tools.output.printing import emit, table, tell
from trocar.tools.systems.find import chosen_system, unknown
from trocar.tools.verbs.options import JsonOption, SystemOption

# What commands to emulated boards were called a version ago; not listed, to be removed with the next version.
FORMER: Final = {
    "push": "apply_effort", "place": "set_position", "hand": "pull_tip", "hand_release": "release_tip",
    "miss_block": "drop_block", "mislabel_replies": "corrupt_tl", "no_mishaps": "clear_packet_faults",
}


def send(
    component: Annotated[str, typer.Argument(metavar="COMPONENT", help="Instance: PSM1, IO1, boards, supervisor…")],
    command: Annotated[str, typer.Argument(metavar="[COMMAND]", help="Command; default: list all commands.")] = "",
    arguments: Annotated[list[str] | None, typer.Argument(metavar="[ARGS]...", help="Numbers and text.")] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait for completion.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", min=0.0, help="Seconds to wait for an answer.")] = 0.0,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Send a command and print the reply. Numbers are in rad, m, s and N; some commands also take text.

    Without a command: list the commands of the component. An effort or a wrench that is sent once lasts 0.1 s
    (arm.effort_timeout_s); zeros last.

    Example: trocar send PSM1 move_jp 0 0 0.12 0 0 0 --wait
    """
    name = chosen_system(system)
    owners = [instance for _, instance, what in names_of(name) if what == "mailbox"]
    if component not in owners:
        raise unknown("component", component, owners)
    with Remote(name, component) as remote:
        if not command:
            return _listed(component, of_type(remote.commands, arm_type(name, component)), as_json)
        known = {str(row["name"]): row for row in remote.commands}
        if component == "boards":
            command, arguments = renamed(command, arguments or [])
        if command not in known:
            there = of_type(remote.commands, arm_type(name, component))
            raise unknown("command", command, [str(row["name"]) for row in there], component)
        values, text = parsed(known[command], arguments or [])
        if known[command].get("text") and not text and "" not in (arguments or []) and _is_users(name, component):
            raise Misuse(f"{command} takes {_takes(known[command])}; no text was given ('': an empty one)")
        limit = timeout or (60.0 if wait else 2.0)
        row = row_of(known[command])
        stops = f"trocar send {component} hold" if row.move else "trocar power-off"
        with only_waiting(stops if row.effect_for(text, values) >= MOTION else ""):
            ask = remote.settled if wait else remote.answered
            reply = ask(command, values, text, limit)
    good = reply.outcome in ("accepted", "done")
    if as_json:
        emit({"component": component, "command": command, "outcome": reply.outcome, "text": reply.text})
    elif good:
        colon = ", " if row.move or row.stream else ": "  # done, clipped: insertion 5.000 → 0.240 m
        tell(reply.outcome + (f"{colon}{reply.text}" if reply.text else ""))
    else:
        reason = reply.text.removeprefix(f"{command}: ") or "no reason given"
        raise Problem(f"{component} {command} {reply.outcome}: {reason}")
    return 0 if good else 1


def _is_users(system: str, component: str) -> bool:
    """Whether a component is a user's process, whose methods take every declared argument."""
    return any((row.name, row.kind) == (component, "user") for row in document_of(system).processes)


def renamed(command: str, words: list[str]) -> tuple[str, list[str]]:
    """A command to boards and its words, by today's names."""
    if command == "board_gone" and len(words) > 1 and words[1] in ("0", "1"):
        return ("unplug_board" if words[1] == "1" else "plug_board"), [words[0], *words[2:]]
    return FORMER.get(command, command), words


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
