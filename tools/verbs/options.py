"""Options that many verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trocar.tools.output.errors import Misuse

CLOCKS = ("wall", "paced", "lockstep")

SystemOption = Annotated[
    str | None,
    typer.Option("--system", envvar="TROCAR_SYSTEM", metavar="NAME",
                 help="System name; default: the only one that is up."),
]
ClockOption = Annotated[
    str, typer.Option("--clock", metavar="CLOCK",
                      help="Clock of the system. wall: real time. paced: simulated time, never faster than real time. "
                      "lockstep: simulated time, as fast as possible. Default: wall with hardware, else paced."),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Value for a key of the file's `trocar:` "
                                   "section, e.g. io.period_s=0.001. docs/configuration.md lists all keys."),
]
PathOption = Annotated[
    list[Path] | None, typer.Option("--path", metavar="FOLDER",
                                    help="Additional folder to search for files; repeatable."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Output as JSON, one object per line.")]


def clock_set(clock: str) -> tuple[str, ...]:
    """What `--clock` sets in the `trocar:` section; Misuse names what is allowed."""
    if clock and clock not in CLOCKS:
        raise Misuse(f"--clock {clock}: allowed are {', '.join(CLOCKS)}")
    return (f"clock={clock}",) if clock else ()
