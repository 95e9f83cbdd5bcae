"""Parts of a topic-table row: fields, views on them, and the ring to which they are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Field:
    """One field: numpy dtype (with shape in front, names allowed), unit, one sentence.

    Fields of a `group` are computed while a client subscribes to it (shm/system/subscriptions.py), and NaN otherwise.
    """

    name: str
    dtype: str
    unit: str
    text: str
    group: str = ""


HEAD_FIELDS = (Field("sequence", "<u8", "", "number of the record, from 1"),
               Field("stamp_ns", "<i8", "ns", "monotonic time of the record"))
"""Fields at the beginning of every record, before those of its row."""


@dataclass(frozen=True, slots=True)
class View:
    """A CRTK name as a view on fields: `per`: the items over which it is repeated, `fields` maps parts of it to fields.

    `kind` is the CRTK payload (js, cp, cv, cf, turn, jacobian); `where` is a flag field that makes it valid.
    """

    name: str
    kind: str
    fields: tuple[tuple[str, str], ...]
    per: str = ""
    where: str = "valid"


@dataclass(frozen=True, slots=True)
class Topic:
    """One ring: its name (the segment's last word), the kind that writes it, rate, depth and fields.

    `depth`: number of slots; 0: as many as its rate needs for the history of its system (shm/system/directory.py).
    """

    name: str
    writer: str
    fields: tuple[Field, ...]
    views: tuple[View, ...] = ()
    rate_hz: float = 0
    depth: int = 0

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of fields that are computed on demand, each once."""
        return tuple(dict.fromkeys(field.group for field in self.fields if field.group))


DTYPES: Final = {"float": "<f8", "float32": "<f4", "int": "<i8", "int32": "<i4", "uint8": "u1", "uint16": "<u2",
                 "bool": "?"}
"""Types of the fields that a user's process declares, in words, and their layout."""


def dtype_of(word: str, shape: tuple[int, ...]) -> str:
    """As in a row of the topic table; for `text` the shape is its bytes. KeyError: there is no such type."""
    if word == "text":
        return f"S{shape[0] if shape else 1}"
    return f"({','.join(map(str, shape))},){DTYPES[word]}" if shape else DTYPES[word]
