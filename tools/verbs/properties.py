"""`trocar get|set NAME.property`: properties of users' processes."""

from __future__ import annotations

import contextlib
from typing import Annotated

import typer

from trocar.procs.document.user_process import PROPERTIES, SET_PROPERTY
from trocar.shm.system import directory
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Misuse
from trocar.tools.output.printing import answer, plain, tell
from trocar.tools.systems.find import chosen_system, unknown
from trocar.tools.verbs.options import JsonOption, SystemOption

HIDDEN = ("sequence", "stamp_ns")


def get(
    name: Annotated[str, typer.Argument(
        metavar="[NAME]", help="NAME or NAME.property; default: all.")] = "",
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Print properties of the recorder and of processes of your own.

    Example: trocar get
    """
    chosen = chosen_system(system)
    owner, _, wanted = name.partition(".")
    owners = _owners(chosen)
    if owner and owner not in owners:
        raise unknown("process with properties", owner, owners)
    for instance in [owner] if owner else owners:
        values = _values(chosen, instance)
        if wanted and wanted not in values:
            raise unknown("property", wanted, values, instance)
        for key in [wanted] if wanted else values:
            answer({"name": instance, "property": key, "value": values[key]}, f"{instance}.{key} = {values[key]}",
                   as_json)
    return 0


def set_property(
    name: Annotated[str, typer.Argument(metavar="NAME.PROPERTY", help="Property to set.")],
    value: Annotated[str, typer.Argument(
        metavar="VALUE", help="New value, within its bounds: a number, or a text.")],
    save: Annotated[bool, typer.Option("--save", help="Save all the process's properties for the next start.")] = False,
    system: SystemOption = None,
) -> int:
    """Set a property of the recorder or of a process of your own, at once.

    Example: trocar set box.stiffness 200 --save
    """
    chosen = chosen_system(system)
    owner, dot, wanted = name.partition(".")
    if not dot:
        raise Misuse(f"{name}: expected NAME.PROPERTY")
    owners = _owners(chosen)
    if owner not in owners:
        raise unknown("process with properties", owner, owners)
    is_text = isinstance(_values(chosen, owner).get(wanted), str)
    values, text = ([], f"{wanted} {value}") if is_text else ([_number(name, value)], wanted)
    with Remote(chosen, owner) as remote:
        remote.ask(SET_PROPERTY, values, text)
        if save:
            remote.ask("save_properties")
    tell(f"{name} = {_values(chosen, owner)[wanted]}")
    return 0


def _number(name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise Misuse(f"{name}: {value} is not a number") from None


def _owners(system: str) -> list[str]:
    return [instance for instance, ring in directory.rings(system) if ring == PROPERTIES]


def _values(system: str, instance: str) -> dict[str, float | str]:
    """What its newest record says; nothing before it has begun."""
    with contextlib.closing(directory.reader(system, instance, PROPERTIES, often=False)) as reader:
        names = [name for name in reader.dtype.names or () if name not in HIDDEN]
        return {name: plain(reader.field(name)[()]) for name in names} if reader.newest() else {}
