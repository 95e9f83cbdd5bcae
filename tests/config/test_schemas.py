"""JSON Schemas for editors: they accept the files that `check` accepts, and mark what a person gets wrong."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fastjsonschema
import pytest
import yaml

from tests.config.conftest import Home
from trocar.procs.config import PROJECT_CONFIGS, check_file, kind_of
from trocar.procs.config.loading.kinds import MODELS, schema_of
from trocar.procs.config.read.source import read_source


@functools.cache
def check_of(kind: str) -> Callable[[Any], object]:
    """Of a schema; compiling it takes a tenth of a second."""
    return fastjsonschema.compile(schema_of(kind))  # type: ignore[no-any-return]


def agrees(path: Path) -> str:
    """The kind of a file that its schema accepts; empty: no schema is for it."""
    source, _ = read_source(path)
    assert source is not None
    kind = kind_of(source.data, path.name)
    if kind not in MODELS:
        return ""
    check_of(kind)(json.loads(json.dumps(source.data)))
    return kind


def test_our_own_files_agree_with_their_schemas() -> None:
    kinds = {agrees(path) for folder in ("arms", "hid", "io", "kinematic", "pid", "systems", "tool")
             for path in (PROJECT_CONFIGS / folder).glob("*.yaml")}
    assert kinds >= {"system", "io", "pid", "psm", "ecm", "mtm", "kinematic", "tool"}


@pytest.mark.parametrize("share", ["dvrk-site", "dvrk-share"])
def test_files_of_others_agree_with_their_schemas_where_check_accepts_them(
        share: str, data: Callable[[str], Path]) -> None:
    files = [path for path in data(share).rglob("*.json")
             if (source := read_source(path)[0]) and kind_of(source.data, path.name) in set(MODELS) - {"system"}]
    fine = [path for path in files if not any(p.severity == "error" for p in check_file(path).problems)]
    assert len(fine) > 10 and all(map(agrees, fine))


@pytest.mark.parametrize("name", ["arms/PSM1-demo", "arms/ECM-demo", "arms/MTML-demo", "arms/SUJ-kinematic",
                                  "io/PSM1-demo", "kinematic/PSM", "pid/PSM", "systems/demo-teleop", "tool/index",
                                  "tool/LARGE_NEEDLE_DRIVER_400006"])
def test_the_schema_that_a_json_file_names_is_ignored(name: str, tmp_path: Path) -> None:
    path = PROJECT_CONFIGS / f"{name}.yaml"
    source, _ = read_source(path)
    assert source is not None and isinstance(source.data, dict)
    problems = []
    for head in ({}, {"$schema": "system.schema.json"}):
        named = tmp_path / f"{path.stem}.json"
        named.write_text(json.dumps({**head, **source.data}, indent=1))
        problems.append([(found.severity, found.key) for found in check_file(named).problems])
    assert problems[0] == problems[1]
    assert agrees(named) == kind_of(source.data, path.name) or kind_of(source.data, path.name) not in MODELS


@pytest.mark.parametrize("name", ["systems/demo", "systems/kinematic-full"])
def test_a_system_whose_files_name_their_schemas_loads_without_a_complaint(name: str, home: Home) -> None:
    for path in home.path.rglob("*.yaml"):
        text = json.dumps({"$schema": "some.schema.json", **yaml.safe_load(path.read_text())})
        path.with_suffix(".json").write_text(text.replace('.yaml"', '.json"'))
        path.unlink()
    loaded = home.load(f"{name}.json")
    assert loaded.system is not None and not loaded.warnings


@pytest.mark.parametrize("change", [{"arms": [{"name": "PSM 1"}]}, {"arms": [{"type": "PSN"}]}, {"IOs": "IO1"},
                                    {"trocar": {"io": {"period_s": -1.0}}}, {"trocar": {"clock": "sundial"}}])
def test_a_mistake_is_marked(change: dict[str, Any]) -> None:
    good = yaml.safe_load((PROJECT_CONFIGS / "systems" / "demo.yaml").read_text())
    for key, value in change.items():
        good[key] = [{**good[key][0], **value[0]}] if isinstance(value, list) else value
    with pytest.raises(fastjsonschema.JsonSchemaValueException):
        check_of("system")(good)
