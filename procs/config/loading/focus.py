"""The `ISI_focus_controller` of a system: the outputs that move the lens, and the pedals that move it."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Final

from trocar.procs.config.loading.buses import BusFiles, file_of_device
from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.system_file import RESERVED, SystemFile
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document.consoles import Focus, WiredInput

KEY: Final = "ISI_focus_controller"
NAME: Final = "focus_controller"
PERIOD_S: Final = 0.01
OUTPUTS: Final = ("endoscope_focus_in", "endoscope_focus_out")
PEDALS: Final = ("focus_plus", "focus_minus")  # in, out
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,40}\Z")


def load_focus(context: Context, source: SourceFile, content: SystemFile, buses: dict[str, BusFiles],
               operators: Collection[str]) -> tuple[Focus, ...]:
    """The focus controller, nothing without one or with errors; `operators` are names that are taken."""
    keys = content.ISI_focus_controller
    if keys is None:
        return ()
    name = keys.name or NAME
    taken = RESERVED | {row.name for rows in (content.IOs, content.arms) for row in rows}.union(operators)
    if name in taken or not _NAME.match(name):
        context.error(source, (KEY, "name"), "not a name of its own", "letters, digits, _ and -, at most 40")
        return ()
    file = file_of_device(context, keys, buses)
    if file is None:
        return ()  # said already
    outputs = [row.name for row in file.digital_outputs]
    missing = [output for output in OUTPUTS if output not in outputs]
    if missing:
        context.error(source, (KEY, "IO_file"), f"{keys.IO_file} has no digital output {', '.join(missing)}",
                      f"a file with {' and '.join(OUTPUTS)}; this one has {', '.join(outputs) or 'none'}")
        return ()
    pedals = [_pedal(buses, pedal) for pedal in PEDALS]
    found = tuple(pedal for pedal in pedals if pedal is not None)
    if len(found) < len(PEDALS):  # with one alone there would be no way back
        context.notes.append(f"{name}: no pedals {' and '.join(PEDALS)}, commands alone move the lens")
    return (Focus(name, PERIOD_S, keys.IO, OUTPUTS, found if len(found) == len(PEDALS) else ()),)


def _pedal(buses: dict[str, BusFiles], name: str) -> WiredInput | None:
    """The first digital input of that name."""
    return next((WiredInput(io, name) for io, bus in buses.items() for file in bus.opened()
                 for row in file.content.digital_inputs if row.name == name), None)
