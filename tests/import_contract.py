"""Contracts of imports (pyproject.toml) in which `processes` stands for every kind of the manifest that has a folder.

Users' processes run in `procs/user`, which is a library, too: it stands on a storey of its own.
"""

from __future__ import annotations

from typing import Any

from importlinter.contracts.forbidden import ForbiddenContract
from importlinter.contracts.layers import LayersContract

from trocar.procs.tables.manifest import PROCS

PROCESSES = sorted({row.module.split(".")[2] for row in PROCS} - {"user"})


def storey(row: str) -> str:
    """One of the layers with the names of the processes in it."""
    return " | ".join(f"procs.{kind}" for kind in PROCESSES) if row == "processes" else row


class Storeys(LayersContract):
    """Layers, of which one is the processes."""

    def __init__(self, name: str, session_options: dict[str, Any], contract_options: dict[str, Any]) -> None:
        layers = [storey(row) for row in contract_options["layers"]]
        super().__init__(name, session_options, {**contract_options, "layers": layers})


class NoProcess(ForbiddenContract):
    """The source modules import no process."""

    def __init__(self, name: str, session_options: dict[str, Any], contract_options: dict[str, Any]) -> None:
        forbidden = [f"trocar.procs.{kind}" for kind in PROCESSES]
        super().__init__(name, session_options, {**contract_options, "forbidden_modules": forbidden})
