"""Stock dVRK files for tests that need a chain or an instrument: read without the configuration code."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from trocar.procs.document.system import Chain, DhLink, JawConfig, Matrix, Tool

TOOLS = (
    "BOWEL_GRASPER_400127",
    "LARGE_NEEDLE_DRIVER_400006",
    "LARGE_NEEDLE_DRIVER_420006",
    "MEGA_NEEDLE_DRIVER_400194",
    "FENESTRATED_BIPOLAR_FORCEPS_400205",
    "NEEDLE_DRIVER_400117",
    "PERMANENT_CAUTERY_HOOK_400183",
    "PROGRASP_FORCEPS_400093",
)  # one of every kind of coupling

ROOT = Path(__file__).resolve().parent.parent


def find(name: str) -> Path:
    """A test data file; skips the test where the data are absent."""
    folder = Path(os.environ.get("TROCAR_TEST_DATA", str(ROOT.parent / "shared" / "data")))
    path = folder / name
    if not path.exists():
        pytest.skip(f"test data {path} is not there (set TROCAR_TEST_DATA)", allow_module_level=True)
    return path


def chain(name: str) -> Chain:
    """kinematic/<name>.json."""
    content = _json(f"dvrk-share/kinematic/{name}.json")
    rows = content["DH"]
    coupling = content.get("coupling", {}).get("ActuatorToJointPosition")
    return Chain(
        convention=rows.get("convention", "modified"),
        links=tuple(_link(row) for row in rows.get("joints", rows.get("links"))),
        base=_matrix(content["base-offset"]) if "base-offset" in content else None,
        actuator_to_joint=_matrix(coupling) if coupling else None,
        source=name,
    )


def tool(name: str) -> Tool:
    """tool/<name>.json."""
    content = _json(f"dvrk-share/tool/{name}.json")
    jaw = content["jaw"]
    engage = content["tool_engage_position"]
    return Tool(
        name=name,
        links=tuple(_link(row) for row in content["DH"].get("joints", content["DH"].get("links"))),
        jaw=JawConfig(jaw["qmin"], jaw["qmax"], jaw["ftmax"]),
        tip=_matrix(content["tooltip_offset"]),
        actuator_to_joint=_matrix(content["coupling"]["ActuatorToJointPosition"]),
        engage_lower=tuple(engage["lower"]),
        engage_upper=tuple(engage["upper"]),
        snake=bool(content.get("snake-like", False)),
        source=name,
        names=(name.rpartition("_")[0],),
        model=name.rpartition("_")[2],
    )


def _link(row: dict[str, Any]) -> DhLink:
    return DhLink(
        name=row["name"],
        joint_type=row.get("type", "revolute"),
        alpha=row.get("alpha", 0.0),
        a=row.get("A", 0.0),
        theta=row.get("theta", 0.0),
        d=row.get("D", 0.0),
        offset=row.get("offset", 0.0),
        lower=row.get("qmin", 0.0),
        upper=row.get("qmax", 0.0),
        effort_max=row.get("ftmax", 0.0),
        mass=row.get("mass", 0.0),
        com=(row.get("cx", 0.0), row.get("cy", 0.0), row.get("cz", 0.0)),
    )


def _matrix(rows: list[list[float]]) -> Matrix:
    return tuple(tuple(float(v) for v in row) for row in rows)


def _json(name: str) -> dict[str, Any]:
    text = find(name).read_text()
    return json.loads(re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL))
