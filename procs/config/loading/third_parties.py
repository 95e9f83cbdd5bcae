"""What of a system is a third-party program: arms of a `_GENERIC` type, and `COMPONENTS` that press pedals."""

from __future__ import annotations

import dataclasses
import re
from typing import Final

from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.base_frame import base_frame_of
from trocar.procs.config.models.system_file import RESERVED, InterfaceKeys, SystemFile
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document.third_party import ThirdParty

GENERIC: Final = "_GENERIC"
COMPONENTS: Final = "COMPONENTS"
BUTTONS: Final = ("clutch", "camera", "operator_present")
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,40}\Z")
_MAX_BUTTON: Final = 24  # what an event has room for


def load_third_parties(context: Context, source: SourceFile, content: SystemFile) -> tuple[ThirdParty, ...]:
    """Generic arms, then other components that a console has its inputs from, with the buttons asked of each."""
    found = {row.name: ThirdParty(row.name, row.type, (), base_frame_of(context, source, ("arms", index), row),
                                  (row.base_frame.reference_frame or "") if row.base_frame else "")
             for index, row in enumerate(content.arms) if row.type.endswith(GENERIC)}
    for index, row in enumerate(content.arms):
        if row.name in found and row.base_frame is not None and row.base_frame.transform is None:
            context.warning(source, ("arms", index, "base_frame"), "the program that is this arm has to take it into "
                            "account itself", "reference_frame and transform")
    for index, console in enumerate(content.consoles):
        for button in BUTTONS if console.input_type == COMPONENTS else ():
            _ask_button(context, source, content, ("consoles", index, button), getattr(console, button), found)
    return tuple(found.values())


def place_of(content: SystemFile, component: str) -> str:
    """Name of the process or place that stands for a component of the file: a generic arm goes by both its names."""
    return next((row.name for row in content.arms if row.type.endswith(GENERIC) and component == row.component),
                component)


def _ask_button(context: Context, source: SourceFile, content: SystemFile, key: Key, keys: InterfaceKeys | None,
                found: dict[str, ThirdParty]) -> None:
    """One input of a console; those of an io are not ours."""
    if keys is None or keys.component in [row.name for row in content.IOs]:
        return
    name = place_of(content, keys.component)
    if name not in found:
        taken = RESERVED | {row.name for rows in (content.arms, content.consoles) for row in rows}
        for console in content.consoles:
            taken |= {f"{row.MTM}_{row.PSM}" for row in console.teleop_PSMs}
            taken |= {f"{row.MTML}_{row.MTMR}_{row.ECM}" for row in console.teleop_ECMs}
        if name in taken or not _NAME.match(name):
            text = "something else that has no buttons" if name in taken else "not a name for a place in the system"
            context.error(source, (*key, "component"), text, "an IO, an arm of a _GENERIC type, or a name of its "
                          "own of letters, digits, _ and -, at most 40, for a program of yours")
            return
        found[name] = ThirdParty(name, "")
    if not 0 < len(keys.interface.encode()) <= _MAX_BUTTON:
        context.error(source, (*key, "interface"), "not a name for a button", f"1 to {_MAX_BUTTON} bytes")
    elif keys.interface not in found[name].inputs:
        found[name] = dataclasses.replace(found[name], inputs=(*found[name].inputs, keys.interface))
