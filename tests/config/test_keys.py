"""What files may say, key by key: type, range and default, compared with keys.txt.

A range that grows by mistake lets nonsense through, a default that moves changes robots whose files say nothing of it.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pydantic

from trocar.procs.config import models

KEYS = Path(__file__).with_name("keys.txt")
SAID_ELSEWHERE = ("description", "title", "properties", "required")


def known() -> Iterator[str]:
    """A line for each key that a section adds to those it inherits, in the order of the code."""
    for module in pkgutil.iter_modules(models.__path__):
        path = f"{models.__name__}.{module.name}"
        for name, model in vars(importlib.import_module(path)).items():
            if isinstance(model, type) and issubclass(model, pydantic.BaseModel) and model.__module__ == path:
                keys = model.model_json_schema()["properties"]
                itself = [part for part in reversed(model.__mro__) if part.__name__ == name]  # see `keys_of`
                names = [own for part in itself for own in vars(part).get("__annotations__", {})]
                for own in filter(model.model_fields.get, names):
                    key = model.model_fields[own].alias or own
                    yield f"{name}.{key} {json.dumps(bare(keys[key]), sort_keys=True)}"


def bare(row: Any) -> Any:
    """Without words."""
    if isinstance(row, dict):
        return {key: bare(value) for key, value in row.items() if key not in SAID_ELSEWHERE}
    return [bare(value) for value in row] if isinstance(row, list) else row


def test_ranges_and_defaults_change_on_purpose_only() -> None:
    found = "".join(f"{line}\n" for line in known())
    if os.environ.get("TROCAR_NEW_KEYS"):
        KEYS.write_text(found)
    assert found == KEYS.read_text(), "if that is wanted, run this test with TROCAR_NEW_KEYS=1"
