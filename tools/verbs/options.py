"""Options that many verbs share."""

from __future__ import annotations

from typing import Annotated

import typer

from trocar.tools.output.errors import Misuse

CLOCKS = ("wall", "paced", "lockstep")

SystemOption = Annotated[
    str | None,
    typer.Option("--system", envvar="TROCAR_SYSTEM", metavar="NAME", help="Which system; default: the only one up."),
]
ClockOption = Annotated[
    str, typer.Option("--clock", metavar="CLOCK",
                      help="wall, paced (simulated, never faster) or lockstep; default: paced without hardware."),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set a key of the `trocar:` section, e.g. "
                                   "io.period_s=0.001; docs/configuration.md lists all keys."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="JSON for programs, one object a line.")]


def clock_set(clock: str) -> tuple[str, ...]:
    """What `--clock` sets in the `trocar:` section; Misuse names what is allowed."""
    if clock and clock not in CLOCKS:
        raise Misuse(f"--clock {clock}: allowed are {', '.join(CLOCKS)}")
    return (f"clock={clock}",) if clock else ()
