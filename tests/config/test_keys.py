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
from trocar.procs.config.models.io_file import IoFile
from trocar.procs.config.read.sections import SafetySection, Section
from trocar.procs.config.read.source import SourceFile
from trocar.procs.config.read.validate import validate
from trocar.procs.document.system import DigitalOutput

KEYS = Path(__file__).with_name("keys.txt")
SAID_ELSEWHERE = ("description", "title", "properties", "required")


def sections() -> Iterator[tuple[str, type[pydantic.BaseModel]]]:
    """All sections in the order of the code; then those that are made from classes of the document."""
    for module in pkgutil.iter_modules(models.__path__):
        path = f"{models.__name__}.{module.name}"
        for name, model in vars(importlib.import_module(path)).items():
            if isinstance(model, type) and issubclass(model, pydantic.BaseModel) and model.__module__ == path:
                yield name, model
    made = {row for base in (Section, SafetySection) for one in base.__subclasses__()
            for row in (one, *one.__subclasses__()) if row.__module__.startswith("trocar.procs.document.")}
    yield from sorted((row.__name__, row) for row in made)


def known() -> Iterator[str]:
    """A line for each key that a section adds to those it inherits."""
    for name, model in sections():
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


def test_a_section_made_from_a_class_of_the_document_has_its_keys_and_gives_its_values(tmp_path: Path) -> None:
    data = {"$id": "saw-robot-io.schema.json", "$version": "6", "digital_outputs": [
        {"name": "lamp", "board_id": 5, "bit_id": 1, "high_duration": 0.1, "PWM_frequency": 4.0, "set_by": "lift"}]}
    content, (problem,) = validate(IoFile, SourceFile(tmp_path, data, {}))
    assert problem.key == "digital_outputs[0].set_by" and problem.text.startswith("unknown key")
    assert content is not None and content.digital_outputs == (DigitalOutput("lamp", 5, 1, high_s=0.1, pwm_hz=4.0),)
