"""Options that many verbs share."""

from __future__ import annotations

from typing import Annotated

import typer

SystemOption = Annotated[
    str | None,
    typer.Option("--system", envvar="TROCAR_SYSTEM", metavar="NAME", help="Which system; default: the only one up."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="JSON for programs, one object a line.")]
