"""Records of rings as messages: their layout in shared memory is that of the same fields in ROS 2 (CDR).

CDR aligns a number to its own size, as numpy does in our records, both little-endian. So a message is four bytes for
"CDR, little-endian", and the record: no conversion, no loss, and readable by any reader of ROS 2 messages. The
definition is made from the ring's schema. Texts are bytes, padded with zeros (`uint8[16]`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from trocar.shm.memory.layout import Schema

ENCAPSULATION: Final = b"\x00\x01\x00\x00"
WORDS: Final = {"b1": "bool", "u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "u4": "uint32", "i4": "int32",
                "u8": "uint64", "i8": "int64", "f4": "float32", "f8": "float64", "f2": "uint16"}
MAX_COMMENT: Final = 200


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """One ring's records as messages: the ROS 2 type with its definition, and the size of a record without padding."""

    schema: Schema
    type_name: str
    definition: str
    size: int


def layout_of(kind: str, schema: Schema) -> RecordLayout:
    """The layout for a ring of a kind of process. The type's name contains the schema's hash, so it fixes the layout.
    """
    words = "".join(word.capitalize() for word in re.findall(r"[A-Za-z0-9]+", f"{kind} {schema.topic}"))
    name = f"trocar_msgs/msg/{words if words[:1].isalpha() else f'R{words}'}{schema.fingerprint:016X}"
    lines, at, used = [], 0, set[str]()
    comments = _comments(schema.text)
    places: Mapping[str, Any] = schema.dtype.fields or {}
    for field in schema.dtype.names or ():
        form, offset = places[field][:2]
        if not form.itemsize:
            continue
        word, size, count = _type(form)
        at += -at % size
        if offset > at:  # numpy aligns to fields without any elements, too
            lines.append(f"uint8[{offset - at}] {_unique(f'padding_{offset}', used)}")
        many = "" if form.subdtype is None and form.kind != "S" else f"[{count}]"
        comment = comments.get(field, "")
        lines.append(f"{word}{many} {_unique(field, used)}" + (f"  # {comment}" if comment else ""))
        at = offset + form.itemsize
    return RecordLayout(schema, name, "\n".join(lines) + "\n", at)


def _type(form: np.dtype[Any]) -> tuple[str, int, int]:
    """The ROS type of a field's elements, their size in bytes, and their number."""
    base = form.base
    if base.kind == "S":
        return "uint8", 1, form.itemsize
    return WORDS[base.str[1:]], base.itemsize, form.itemsize // base.itemsize


def _unique(name: str, used: set[str]) -> str:
    """A field's name in a form that ROS allows: lower-case letters, digits and single underscores."""
    plain = re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", name.lower())).strip("_") or "field"
    plain = plain if plain[0].isalpha() else f"f_{plain}"
    found = next(each for n in range(1, 1000) if (each := f"{plain}_{n}" if n > 1 else plain) not in used)
    used.add(found)
    return found


def _comments(text: bytes) -> dict[str, str]:
    rows = json.loads(text)["fields"]
    said = {row["name"]: f"{row.get('unit', '')}: {row.get('text', '')}".strip(": ") for row in rows}
    return {name: "".join(c if c.isprintable() else " " for c in words)[:MAX_COMMENT] for name, words in said.items()}
