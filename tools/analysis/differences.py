"""Differences between two recordings of one topic: the paired records, and the difference of each field."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.recordings.reading import Records

STAMP, START, SEQUENCE = "stamp", "start", "sequence"
ALIGNMENTS: Final = {
    STAMP: "records of the same stamp: of simulated time, or of one run",
    START: "the same, counted from the first record of each",
    SEQUENCE: "records of the same number",
}
HEAD: Final = ("sequence", "stamp_ns")
Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Pairs:
    """Paired records: their indices in A and in B, and the unpaired ones."""

    a: NDArray[np.intp]
    b: NDArray[np.intp]
    only_a: NDArray[np.intp]
    only_b: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.a)


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """One field with differences. For texts and flags `most` and `rms` are NaN.

    `count`: records that differ. `first` and `worst` locate them: stamp (of A), number (of A), element, both values.
    `beyond`: records that differ by more than the tolerance.
    """

    name: str
    unit: str
    count: int
    beyond: int
    most: float
    rms: float
    tolerance: float
    first: dict[str, Any]
    worst: dict[str, Any]


@dataclass(frozen=True, slots=True)
class TopicDifference:
    """One topic: numbers of paired and unpaired records, and the differences in the pairs."""

    name: str
    compared: int
    only_a: int
    only_b: int
    first_only_a_ns: int | None
    first_only_b_ns: int | None
    fields: tuple[FieldDifference, ...]
    unknown: tuple[str, ...] = ()
    """Fields that only one recording has, or that differ in type or shape."""

    @property
    def is_equal(self) -> bool:
        """Whether all records are equal bit for bit, except for the omitted fields."""
        return not (self.fields or self.only_a or self.only_b or self.unknown)

    @property
    def is_within(self) -> bool:
        """Whether no field is beyond its tolerance, and no record is unpaired."""
        return not (self.only_a or self.only_b or self.unknown or any(field.beyond for field in self.fields))


def paired(a: Records, b: Records, how: str) -> Pairs:
    """Pairs of records: those with the same key, else the nearest ones within half of the usual spacing."""
    key_a, key_b = keys(a, how), keys(b, how)
    if not len(key_a) or not len(key_b):
        return Pairs(np.arange(0), np.arange(0), np.arange(len(key_a)), np.arange(len(key_b)))
    order = np.argsort(key_b, kind="stable")
    of_b = key_b[order]
    right = np.clip(np.searchsorted(of_b, key_a), 0, len(of_b) - 1)
    left = np.maximum(right - 1, 0)
    near = np.where(np.abs(of_b[left] - key_a) < np.abs(of_b[right] - key_a), left, right)
    distance = np.abs(of_b[near] - key_a)
    room = 0 if how == SEQUENCE else int(np.median(np.diff(of_b))) // 2 if len(of_b) > 1 else 0
    found = np.flatnonzero(distance <= room)
    found = found[np.lexsort((distance[found], near[found]))]  # of several near one the nearest
    found = np.sort(found[np.concatenate(([True], np.diff(near[found]) != 0))[: len(found)]])
    of_both = order[near[found]]
    return Pairs(found, of_both, np.setdiff1d(np.arange(len(key_a)), found),
                 np.setdiff1d(np.arange(len(key_b)), of_both))


def keys(records: Records, how: str) -> NDArray[np.int64]:
    """Keys by which records are paired."""
    stamps = records.rows["stamp_ns"].astype(np.int64)
    if how == SEQUENCE:
        return records.rows["sequence"].astype(np.int64)
    return stamps - (stamps[:1].sum() if how == START else 0)


def in_common(a: Records, b: Records) -> tuple[Records, Records]:
    """Records of the numbers that both have."""
    key_a, key_b = keys(a, SEQUENCE), keys(b, SEQUENCE)
    if not len(key_a) or not len(key_b):
        return _part(a, np.zeros(len(key_a), np.bool_)), _part(b, np.zeros(len(key_b), np.bool_))
    begin, end = max(key_a.min(), key_b.min()), min(key_a.max(), key_b.max())
    return _part(a, (key_a >= begin) & (key_a <= end)), _part(b, (key_b >= begin) & (key_b <= end))


def _part(records: Records, chosen: NDArray[np.bool_]) -> Records:
    return Records(records.rows[chosen], records.local_ns[chosen], records.epoch[chosen])


def compared(name: str, a: Records, b: Records, how: str, left_out: Sequence[str] = (),
             units: dict[str, str] | None = None, tolerance: Callable[[str, str], float] = lambda field, unit: 0.0
             ) -> TopicDifference:
    """Differences between two recordings of a topic; `tolerance` is called for a field with its unit."""
    pairs, known = paired(a, b, how), units or {}
    rows_a, rows_b = a.rows[pairs.a], b.rows[pairs.b]
    fields, unknown = [], []
    named = dict.fromkeys((*(a.rows.dtype.names or ()), *(b.rows.dtype.names or ())))
    for field in named:
        if field in left_out or (field in HEAD and how != STAMP):
            continue
        if not _has(rows_a, field) or not _has(rows_b, field) or rows_a.dtype[field] != rows_b.dtype[field]:
            unknown.append(field)
            continue
        unit = "ns" if field == "stamp_ns" else known.get(field, "")
        found = _field(field, unit, tolerance(field, unit), rows_a, rows_b)
        if found is not None:
            fields.append(found)
    alone_a, alone_b = a.rows["stamp_ns"][pairs.only_a], b.rows["stamp_ns"][pairs.only_b]
    return TopicDifference(name, len(pairs), len(alone_a), len(alone_b), _first(alone_a), _first(alone_b),
                           tuple(fields), tuple(unknown))


def _has(rows: Array, field: str) -> bool:
    return field in (rows.dtype.names or ())


def _first(stamps: Array) -> int | None:
    return int(stamps[0]) if len(stamps) else None


def _field(name: str, unit: str, tolerance: float, rows_a: Array, rows_b: Array) -> FieldDifference | None:
    """None where all is the same, bit for bit; NaN is NaN."""
    if not len(rows_a):
        return None
    a, b = (np.ascontiguousarray(rows[name]).reshape(len(rows), -1) for rows in (rows_a, rows_b))
    other = ~same(a, b)
    if not other.any():
        return None
    size = distance(a, b)
    beyond = other & ~(size <= tolerance)  # NaN is beyond
    records = other.any(axis=1)
    is_number, finite = a.dtype.kind in "iuf", np.isfinite(size)
    size = np.where(finite, size, 0.0)

    def where(place: int) -> dict[str, Any]:
        row, element = divmod(place, a.shape[1])
        return {"stamp_ns": int(rows_a["stamp_ns"][row]), "sequence": int(rows_a["sequence"][row]),
                "element": element if rows_a.dtype[name].subdtype is not None else None,
                "a": plain(a[row, element]), "b": plain(b[row, element])}

    first = where(int(np.flatnonzero(other)[0]))
    worst = where(int(size.argmax())) if is_number and size.any() else first
    return FieldDifference(
        name, unit, int(records.sum()), int(beyond.any(axis=1).sum()),
        float(size.max()) if is_number and finite.any() else float("nan"),
        float(np.sqrt(np.mean(size[finite] ** 2))) if is_number and finite.any() else float("nan"),
        tolerance, first, worst)


def same(a: Array, b: Array) -> NDArray[np.bool_]:
    """Where two arrays (k, n) of one or two types have the same bits, or both NaN."""
    if a.dtype != b.dtype or a.dtype.kind != "f":
        return np.asarray(a == b, np.bool_)
    word = np.dtype(f"<u{a.dtype.itemsize}")
    return np.asarray((a.view(word) == b.view(word)) | (np.isnan(a) & np.isnan(b)), np.bool_)


def distance(a: Array, b: Array) -> NDArray[np.float64]:
    """Difference of numbers (k, n); NaN if one is not a number, or for texts and flags."""
    if a.dtype.kind not in "iuf" or b.dtype.kind not in "iuf":
        return np.full(a.shape, np.nan)
    with np.errstate(invalid="ignore", over="ignore"):
        if a.dtype.kind == b.dtype.kind == "u":
            return np.where(a > b, a - b, b - a).astype(np.float64)
        if a.dtype.kind == b.dtype.kind == "i":  # the difference of two int64 has room as uint64
            wide_a, wide_b = (x.astype(np.int64).view(np.uint64) for x in (a, b))
            return np.where(a > b, wide_a - wide_b, wide_b - wide_a).astype(np.float64)
        found = np.abs(a.astype(np.float64) - b.astype(np.float64))
    return np.where(np.isinf(found) | (np.isinf(a) & (a == b)), np.where(a == b, 0.0, np.nan), found)
