"""Fields of io's record are attributes that mypy does not know: each name in the code is one of the topic's."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from trocar.procs.io.record import IoRecord
from trocar.shm.topics import IO_STATE

PROJECT = Path(__file__).parents[2]
OWN = {name for name in vars(IoRecord) if not name.startswith("__")}


def used() -> Iterator[tuple[str, str]]:
    """Places and names: attributes of `record`, `_record`, `self.record` and the like in code of io."""
    for file in sorted((PROJECT / "procs" / "io").rglob("*.py")):
        if file.name == "instruments.py":  # its record is another topic's
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute) and ast.unparse(node.value).rpartition(".")[2] in ("record", "_record"):
                yield f"{file.relative_to(PROJECT)}:{node.lineno}", node.attr


def test_each_name_is_a_field() -> None:
    known = {field.name for field in IO_STATE.fields} | OWN
    found = list(used())
    assert len(found) > 100
    assert [place for place in found if place[1] not in known] == []
