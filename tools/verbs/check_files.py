"""`trocar check`: validate configuration files without starting anything."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Annotated, Any

import typer

from trocar.tools.verbs.options import JsonOption


def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="System files, or any file a system names.")],
    path: Annotated[list[Path] | None, typer.Option("--path", help="Also look for named files here.")] = None,
    boards: Annotated[str | None, typer.Option("--boards", help="`emulated`, `real`: as `up` would start it.")] = None,
    sets: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set a Trocar value.")] = None,
    as_json: JsonOption = False,
) -> Any:
    """Validate configuration files: each mistake with file, line, key, value and what is allowed.

    Example: trocar check configs/systems/demo.yaml
    """
    return importlib.import_module("trocar.tools.verbs.check").run(files, path or [], as_json, boards, sets or [])
