"""JSON formatted for people: one key a line, rows of numbers on one line."""

from __future__ import annotations

import json

_STEP = "    "


def to_json(data: object) -> str:
    """A text that ends with a newline; numbers keep all their digits."""
    return f"{_value(data, '')}\n"


def _value(data: object, indent: str) -> str:
    inner = indent + _STEP
    if isinstance(data, dict) and data:
        rows = [f"{inner}{json.dumps(key, ensure_ascii=False)}: {_value(item, inner)}" for key, item in data.items()]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    if isinstance(data, list | tuple) and any(isinstance(item, dict | list | tuple) for item in data):
        return "[\n" + ",\n".join(f"{inner}{_value(item, inner)}" for item in data) + f"\n{indent}]"
    return json.dumps(data, ensure_ascii=False, allow_nan=False)
