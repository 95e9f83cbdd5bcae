"""Makes docs/errors.md from its table: `python -m trocar.tools.pages.errors`; `--check` only compares."""

from __future__ import annotations

import sys
from typing import Final

from trocar.procs.machine.paths import ROOT
from trocar.procs.tables.code_row import CUT, NOTHING, POWER_OFF, STOP, Code
from trocar.procs.tables.codes import CODES, FAULTS
from trocar.shm.system.events import SEVERITIES
from trocar.tools.pages.generated import keep

PAGE = ROOT / "docs" / "errors.md"
HEAD = """# Warnings and errors

This page lists the codes of all warnings and errors. It is generated from `procs/tables/codes.py` by
`python -m trocar.tools.pages.errors`; do not edit it.

Each warning or error that a process reports has one of these codes. Its text names the component, the cause and the
measured value. `trocar logs`, `trocar status` and `trocar echo PSM1/events` also print the remedy, with the name of the
arm or process in place of NAME. In a remedy, text that begins with `trocar` is a command to type. Terms such as *homed*
and *stream* are in the [glossary](glossary.md).
"""
OF_IO = """
## What I/O does

The `io` processes report the faults in this table, each with its number. Unused numbers are left out. The event of a
fault gives the robot, the axis, the measured value and the limit. Axes are numbered from 0: first the actuators, then
the brakes.

If several faults occur in one cycle, io reports them all. The first fault that switches something off is latched: its
number stays in the field `fault` of `IO1/state`. While a fault is latched, the joint controller cannot be switched on.
A further fault that switches something off is reported once, not in every cycle. The next power-on clears the latch.

"Continues" means that io switches nothing off. The arm itself may hold its position, or stay off.

| number | code | I/O does |
|---|---|---|
"""
ACTIONS: Final = {
    NOTHING: "reports, and continues",
    STOP: "joint controller off, zero current, brakes hold",
    POWER_OFF: "joint controller, amplifiers and motor power off, brakes hold",
    CUT: "joint controller, amplifiers and motor power off, brakes hold, safety relays open",
}


def page() -> str:
    """The whole page: all codes by kind of process, then io's reactions to its faults."""
    kinds = dict.fromkeys(row.owner.partition(",")[0] for row in CODES)
    parts = [f"\n## Reported by {kind}\n\n| code | severity | reported by | cause | remedy |\n|---|---|---|---|---|\n"
             + "".join(_row(row) for row in CODES if row.owner.partition(",")[0] == kind) for kind in kinds]
    return HEAD + "".join(parts) + OF_IO + "".join(
        f"| {row.number} | `{row.code}` | {ACTIONS[row.action]} |\n" for row in FAULTS)


def _row(row: Code) -> str:
    return f"| `{row.code}` | {SEVERITIES[row.severity]} | {row.owner} | {row.cause} | {row.remedy} |\n"


if __name__ == "__main__":
    sys.exit(keep(PAGE, page(), sys.argv[1:]))
