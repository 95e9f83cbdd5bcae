"""Paths of fields in topics, for verbs and the web console's plots: `PSM1/measured_js.position[0:3]`.

A path is a topic as listed by `trocar list`, a dot, a field, and indices in brackets, at most one per dimension:
`[2]`, `[0:3]`, `[-1]`, `[0][4]`, `[0,4]`. Without a dot it is the whole topic.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.names import none_such
from trocar.procs.crtk.topics import EVENT, TopicEntry
from trocar.shm.memory.rows import HEAD_FIELDS, Field

MAX_LENGTH: Final = 200
PATH: Final = re.compile(r"(?P<topic>[\w-]+(?:/[\w-]+)+)"
                         r"(?:\.(?P<field>[A-Za-z_][\w/-]*)(?P<indices>(?:\[[^\[\]]*\])*))?", re.ASCII)
INDEX: Final = re.compile(r"(?P<one>-?\d{1,6})|(?P<first>-?\d{0,6}):(?P<end>-?\d{0,6})", re.ASCII)
MEANT: Final = "a field is written as PSM1/measured_js.position[0] or [0:3]; trocar list -v shows all fields"
PIECES: Final = {
    "cp": {"position": ("pose", slice(0, 3)), "orientation": ("pose", slice(3, 7))},
    "cv": {"linear": ("twist", slice(0, 3)), "angular": ("twist", slice(3, 6))},
    "cf": {"force": ("wrench", slice(0, 3)), "torque": ("wrench", slice(3, 6))},
}
"""Fields of payloads as shown by `echo`: the view's part that contains each, and the slice of it."""
VALID: Final = Field("valid", "?", "", "whether the values may be used")
NAMES: Final = Field("name", "S", "", "names of the joints")

Index = int | slice


class BadPath(ValueError):
    """The text is no path, or not one of this topic; the message has the allowed form."""


@dataclass(frozen=True, slots=True)
class FieldPath:
    """A parsed path; `field` is empty for the whole topic."""

    text: str
    topic: str
    field: str = ""
    indices: tuple[Index, ...] = ()


def parse_path(text: str) -> FieldPath:
    """Parse a path; BadPath if it is not one."""
    found = PATH.fullmatch(text) if len(text) <= MAX_LENGTH else None
    if found is None:
        raise BadPath(f"{text[:80]!r} is no field: {MEANT}")
    indices = tuple(_index(word.strip(), text) for part in re.findall(r"\[([^\[\]]*)\]", found["indices"] or "")
                    for word in part.split(","))
    return FieldPath(text, found["topic"], found["field"] or "", indices)


def _index(word: str, text: str) -> Index:
    found = INDEX.fullmatch(word)
    if found is None:
        raise BadPath(f"{text[:80]}: [{word[:20]}] is no index; allowed are [2], [-1], [0:3] and [:]")
    if found["one"] is not None:
        return int(found["one"])
    first, end = (int(part) if part not in ("", "-") else None for part in (found["first"], found["end"]))
    return slice(first, end)


@dataclass(frozen=True, slots=True)
class FieldCells:
    """The cells of a ring's records that a path selects.

    `flat`: their indices in the flattened field; `labels`: a path for each. `flag`: the field that shows whether a
    record's values are valid, empty: always; `flag_row`: the index if that is a list. `constants`: the values, if they
    are not in records.
    """

    field: Field
    flat: NDArray[np.intp]
    labels: tuple[str, ...]
    shape: tuple[int, ...]
    is_text: bool
    flag: str = ""
    flag_row: int = -1
    constants: tuple[Any, ...] = ()

    def numbers(self, rows: NDArray[Any]) -> NDArray[np.float64]:
        """The values (records, cells) in structured records; NaN in records that are not valid."""
        if self.is_text:
            raise BadPath(f"{self.labels[0]} is text, no number")
        found: NDArray[np.float64] = self.raw(rows).astype(np.float64)
        found[~self.valid(rows)] = np.nan
        return found

    def raw(self, rows: NDArray[Any]) -> NDArray[Any]:
        """The values as recorded, including texts, whether valid or not."""
        if self.constants:
            return np.tile(np.array(self.constants)[self.flat], (len(rows), 1))
        column = rows[self.field.name]
        found: NDArray[Any] = column.reshape(len(rows), math.prod(column.shape[1:]))[:, self.flat]
        return found

    def valid(self, rows: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether each record is valid."""
        if not self.flag:
            return np.ones(len(rows), np.bool_)
        flags = rows[self.flag]
        return np.asarray(flags if self.flag_row < 0 else flags[:, self.flag_row], np.bool_)


def cells_of(entry: TopicEntry, path: FieldPath, record: NDArray[Any]) -> FieldCells:
    """The cells of `path` in the records of a topic; BadPath lists the allowed ones.

    `record`: its newest record (1,), which has the number of joints for an arm's views.
    """
    if entry.kind == EVENT:
        raise BadPath(f"{path.text}: {entry.name} is an event, without fields; use "
                      f"{entry.instance}/events.{path.field or 'value'}")
    field, places, constants = _found(entry, path, record)
    numbered = np.arange(places.size, dtype=np.intp).reshape(places.shape)
    try:
        chosen = numbered[path.indices] if path.indices else numbered
    except IndexError:
        raise BadPath(f"{path.text}: {path.field} has {_sized(places.shape)}") from None
    chosen = np.asarray(chosen, dtype=np.intp)
    if not chosen.size:
        raise BadPath(f"{path.text}: nothing is in that range; {path.field} has {_sized(places.shape)}")
    base = f"{path.topic}.{path.field}"
    labels = tuple(base + indices_text(np.unravel_index(one, places.shape) if places.shape else ())
                   for one in chosen.ravel().tolist())
    is_text = field is NAMES or (not constants and record[field.name].dtype.kind == "S")
    flag = entry.view.where if entry.view is not None and not constants and field.text is not VALID.text else ""
    flag = flag if flag in (record.dtype.names or ()) else ""
    return FieldCells(field, places.ravel()[chosen.ravel()], labels, chosen.shape, is_text, flag,
                      entry.row if flag and record[flag].ndim > 1 else -1, constants)


def all_cells(entry: TopicEntry, record: NDArray[Any]) -> list[FieldCells]:
    """The cells of all fields of a topic, except fields without cells."""
    found = []
    for name in _fields(entry):
        try:
            found.append(cells_of(entry, FieldPath(f"{entry.name}.{name}", entry.name, name), record))
        except BadPath:  # no joints
            continue
    return found


def indices_text(indices: Sequence[Any]) -> str:
    """Indices in the notation of paths."""
    return "".join(f"[{int(index)}]" for index in indices)


def _fields(entry: TopicEntry) -> list[str]:
    """Names of a topic's fields: those of its records, or of its view."""
    if entry.view is None:
        return [field.name for field in entry.fields]
    pieces = PIECES.get(entry.view.kind, {})
    return [*pieces] or [part for part, _ in entry.view.fields]


def _found(entry: TopicEntry, path: FieldPath, record: NDArray[Any]) -> tuple[Field, NDArray[np.intp], tuple[Any, ...]]:
    """The field of a path, the indices of its cells, and its values if they are not in records."""
    if entry.view is not None and path.field == VALID.name:
        if entry.view.where in (record.dtype.names or ()):
            return dataclasses.replace(VALID, name=entry.view.where), np.array(max(entry.row, 0)), ()
        return VALID, np.array(0), (True,)
    if path.field == NAMES.name and (names := _constant_names(entry)):
        return NAMES, np.arange(len(names)), names
    name, cut = _named(entry, path)
    column = record[name]
    places = np.arange(column[0].size, dtype=np.intp).reshape(column.shape[1:])
    field = next(each for each in (*entry.fields, *HEAD_FIELDS) if each.name == name)
    return field, places if entry.view is None or field in HEAD_FIELDS else _joints(entry, places, record)[cut], ()


def _constant_names(entry: TopicEntry) -> tuple[str, ...]:
    """Names of a view's joints if its records do not have them."""
    is_without = entry.view is not None and entry.view.kind == "js" and NAMES.name not in dict(entry.view.fields)
    return entry.joint_names if is_without else ()


def _shown(entry: TopicEntry) -> list[str]:
    """All fields that have a path."""
    if entry.view is None:
        return _fields(entry)
    return [VALID.name, *(NAMES.name for _ in _constant_names(entry)[:1]), *_fields(entry)]


def _named(entry: TopicEntry, path: FieldPath) -> tuple[str, Index]:
    """The field of the record, and its part."""
    if path.field in (field.name for field in HEAD_FIELDS):
        return path.field, slice(None)
    if entry.view is None:
        if any(field.name == path.field for field in entry.fields):
            return path.field, slice(None)
    else:
        parts = dict(entry.view.fields)
        part, cut = PIECES.get(entry.view.kind, {}).get(path.field, (path.field, slice(None)))
        if part in parts:
            return parts[part], cut
    if not path.field:
        raise BadPath(f"{path.text} is a whole topic; its fields are: {', '.join(_shown(entry))[:300]}")
    raise BadPath(f"{path.text}: {none_such('field', path.field, _shown(entry))}")


def _joints(entry: TopicEntry, places: NDArray[np.intp], record: NDArray[Any]) -> NDArray[np.intp]:
    """The cells of a view's robot or setup arm; for an arm, those of its existing joints."""
    if not places.ndim:
        return places.reshape(1)
    if entry.row >= 0:
        return places[entry.row, : entry.count if entry.kind == "js" else None]
    if entry.count:
        return places[entry.first : entry.first + entry.count]
    if places.shape[-1] == 8 and "count" in (record.dtype.names or ()):
        count = int(record["count"][0])
        return places[..., : count if 0 < count <= 8 else 8]
    return places


def _sized(shape: tuple[int, ...]) -> str:
    return f"{' × '.join(map(str, shape))} numbers, counted from 0" if shape else "one value and takes no index"
