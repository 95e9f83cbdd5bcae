"""Search for an instrument in the tool indexes by name: NAME:MODEL or :MODEL, each with an optional version.

The version is that in the memory of an instrument (`NAME:MODEL[12]`), or the range of an entry in an index
(`NAME:MODEL[12..]`, `[..11]`, `[..]` for any). For a model with several entries the version is required.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

LONGEST: Final = 100  # characters of a name that are used
CANDIDATES: Final = 6  # suggestions at most
_NAME = re.compile(r"(?P<name>[^:\[\]]*):(?P<model>[^:\[\]]+)(?::?\[(?P<range>[^\[\]]*)\]|:(?P<version>\d+))?")
_UNDERSCORE = re.compile(r"(?P<name>.+)_(?P<model>\d{5,})(?P<rest>(?:_|:|\[).*)?")
_RANGE = re.compile(r"(?P<low>\d{1,9})?(?P<dots>\.\.)?(?P<high>\d{1,9})?")


class CatalogueEntry(Protocol):
    """Names and versions of an instrument; version limits are inclusive, None without a limit."""

    @property
    def names(self) -> tuple[str, ...]:
        """All its names, the usual one first."""

    @property
    def model(self) -> str:
        """Its model number, as text."""

    @property
    def version_min(self) -> int | None:
        """The first version that it covers."""

    @property
    def version_max(self) -> int | None:
        """The last version that it covers."""


E = TypeVar("E", bound=CatalogueEntry)


@dataclass(frozen=True, slots=True)
class CatalogueMatch(Generic[E]):
    """`entry`, or None with the `reason`; `candidates`: suggestions, `note`: how the name was interpreted."""

    entry: E | None
    reason: str = ""
    candidates: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True, slots=True)
class ParsedName:
    """A parsed name; without a version `low` and `high` are None."""

    name: str
    model: str
    low: int | None = None
    high: int | None = None
    note: str = ""

    @property
    def version(self) -> str:
        """The version in brackets; empty without one."""
        if self.low is None and self.high is None:
            return ""
        return f"[{_ends(self.low, self.high) if self.low != self.high else self.low}]"


def full_name(entry: CatalogueEntry) -> str:
    """NAME:MODEL, with the version limits of an entry: LARGE_NEEDLE_DRIVER:420006[12..]."""
    limited = entry.version_min is not None or entry.version_max is not None
    versions = f"[{_ends(entry.version_min, entry.version_max)}]" if limited else ""
    return f"{''.join(entry.names[:1])}:{entry.model}{versions}"


def _ends(low: int | None, high: int | None) -> str:
    return f"{'' if low is None else low}..{'' if high is None else high}"


def taken_apart(text: str) -> ParsedName | None:
    """Parse a name; None when it is not one."""
    text = text.strip()[:LONGEST]
    note = ""
    loose = _UNDERSCORE.fullmatch(text) if ":" not in text.split("[")[0] else None
    if loose is not None:  # notation of the dVRK's arm files
        rest = (loose["rest"] or "").lstrip("_")
        text = f"{loose['name']}:{loose['model']}" + (f":{rest}" if rest and rest[0] not in ":[" else rest)
        note = f"taken as {text}"
    match = _NAME.fullmatch(text)
    if match is None:
        return None
    low = high = None
    if match["version"]:
        low = high = int(match["version"][:9])
    elif match["range"] is not None:
        ends = _RANGE.fullmatch(match["range"].strip())
        if ends is None or not match["range"].strip() or (ends["high"] and not ends["dots"]):
            return None
        low = int(ends["low"]) if ends["low"] else None
        high = int(ends["high"]) if ends["high"] else (None if ends["dots"] else low)
    return ParsedName(match["name"].strip().upper(), match["model"].strip(), low, high, note)


def find(text: str, entries: Sequence[E]) -> CatalogueMatch[E]:
    """The one entry that `text` names; never raises."""
    asked = taken_apart(text)
    if asked is None:
        return CatalogueMatch(None, "not a name of an instrument: NAME:MODEL or NAME:MODEL[VERSION]",
                              _like(text, entries))
    models = [entry for entry in entries if entry.model == asked.model]
    named = [entry for entry in models if not asked.name or asked.name in (name.upper() for name in entry.names)]
    if not models:
        return CatalogueMatch(None, f"no instrument of model {asked.model} is known", _like(text, entries), asked.note)
    if not named:
        return CatalogueMatch(None, f"model {asked.model} is not called {asked.name}", _names(models), asked.note)
    fitting = [entry for entry in named if _fits(entry, asked)]
    if not fitting:
        return CatalogueMatch(None, f"no entry covers version {asked.version}", _names(named), asked.note)
    if len(fitting) == 1:
        return CatalogueMatch(fitting[0], note=asked.note)
    if len({entry.names[:1] for entry in fitting}) > 1:
        return CatalogueMatch(None, f"several instruments are of model {asked.model}", _names(fitting), asked.note)
    return CatalogueMatch(None, "several versions of this instrument exist: specify one", _names(fitting), asked.note)


def _fits(entry: CatalogueEntry, asked: ParsedName) -> bool:
    lowest = entry.version_min if entry.version_min is not None else 0
    return all(lowest <= version and (entry.version_max is None or version <= entry.version_max)
               for version in (asked.low, asked.high) if version is not None)


def _names(entries: Iterable[CatalogueEntry]) -> tuple[str, ...]:
    return tuple(full_name(entry) for entry in entries)[:CANDIDATES]


def _like(text: str, entries: Sequence[CatalogueEntry]) -> tuple[str, ...]:
    """Suggestions for a name: similar ones, or all if there are few."""
    if len(entries) <= CANDIDATES:
        return _names(entries)
    wanted = re.sub(r"\[.*|[:_]\d+.*", "", text[:LONGEST]).upper()
    known = [(f"{name}:{entry.model}", full_name(entry)) for entry in entries for name in entry.names]
    hits = [full for spelled, full in known if wanted and spelled.startswith(f"{wanted}:")]
    close = difflib.get_close_matches(text[:LONGEST].upper(), [spelled for spelled, _ in known], n=3, cutoff=0.6)
    hits += [full for spelled, full in known if spelled in close]
    return tuple(dict.fromkeys(hits))[:CANDIDATES]
