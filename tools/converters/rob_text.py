"""`.rob` files, the kinematic chains of the first versions: the number of links, then one line of numbers a link.

A line is: convention, alpha, a, theta, d, type, mode, offset, qmin, qmax, then perhaps the largest effort, mass, centre
of mass, principal moments and principal axes. Lengths in m, angles in rad, as today. Text after the last link is a
remark.
"""

from __future__ import annotations

import re

from trocar.tools.converters.report import ConversionReport, Json, finite

_CONVENTIONS = ("standard", "modified")
_TYPES = {"revolute": "revolute", "hinge": "revolute", "prismatic": "prismatic", "slider": "prismatic"}
_MODES = ("active", "passive")
_GEOMETRY = ("alpha", "A", "theta", "D")
_NUMBERS = ("offset", "qmin", "qmax", "ftmax", "mass", "cx", "cy", "cz", "Ixx", "Iyy", "Izz")
_AXES = ("x1", "x2", "x3", "y1", "y2", "y3", "z1", "z2", "z3")
_WORDS = 1 + len(_GEOMETRY) + 2
_MAX_LINKS = 16
_COUNT = re.compile(r"[0-9]{1,4}\Z")


def looks_like_rob(text: str) -> bool:
    """Whether a text starts as these files do: a number alone, then a line that names a convention."""
    lines = text.splitlines()
    first = lines[0].split() if lines else []
    words = lines[1].split() if len(lines) > 1 else []
    named = bool(words) and words[0].lower() in (*_CONVENTIONS, "hayati")
    return named and len(first) == 1 and _COUNT.match(first[0]) is not None


def convert_rob(text: str, report: ConversionReport) -> Json:
    """The kinematic file of a text that looks like one; of no use when the report has problems."""
    lines = text.splitlines()
    count = int(lines[0])
    if not 1 <= count <= _MAX_LINKS:
        report.error(1, "number of links", lines[0].strip(), "out of range", f"a whole number from 1 to {_MAX_LINKS}")
        return {}
    if len(lines) <= count:
        report.error(1, "number of links", str(count), f"the file has {len(lines) - 1}", str(len(lines) - 1))
        return {}
    links = [_link(line, number, report) for number, line in enumerate(lines[1 : count + 1], 1)]
    for number, line in enumerate(lines[count + 1 :], count + 2):
        if line.strip():
            report.dropped(number, f"line {number}", " ".join(line.split()), "a remark")
    conventions = list(dict.fromkeys(str(link.pop("convention", "")) for link in links))
    if len(conventions) > 1 and not report.problems:
        text = f"{' and '.join(conventions)} in one chain"
        report.error(2, "convention", "", text, "one convention for the whole chain")
    return {"DH": {"convention": conventions[0], "joints": links}}


def _link(line: str, number: int, report: ConversionReport) -> Json:
    words = line.split()
    at = number + 1
    if len(words) < _WORDS:
        text = f"{len(words)} words"
        allowed = "convention, alpha, a, theta, d, type, mode, offset, qmin, qmax, …"
        report.error(at, f"link {number}", "", text, allowed)
        return {}
    convention, kind, mode = (words[at_word].lower() for at_word in (0, 5, 6))
    known: tuple[tuple[str, str, tuple[str, ...]], ...] = (
        ("convention", convention, _CONVENTIONS), ("type", kind, tuple(_TYPES)), ("mode", mode, _MODES))
    for name, word, words_known in known:
        if word not in words_known:
            report.error(at, f"link {number} {name}", word, "unknown word", ", ".join(words_known))
    row: Json = {"convention": convention}
    row |= _numbers(words[1:5], _GEOMETRY, number, report)
    row |= {"type": _TYPES.get(kind, kind), "mode": mode}
    names = (*_NUMBERS, *_AXES)
    given = words[_WORDS:]
    row |= _numbers(given[: len(names)], names, number, report)
    if len(given) > len(names):
        report.dropped(at, f"link {number}", " ".join(given[len(names) :]), "after the last number that was read")
    for name in ("qmin", "qmax"):
        if name not in row:
            report.defaulted(at, f"link {number} {name}", "0", "the line ends before it")
    return row


def _numbers(words: list[str], names: tuple[str, ...], number: int, report: ConversionReport) -> Json:
    row: Json = {}
    for name, word in zip(names, words, strict=False):
        value = finite(word)
        if value is None:
            report.error(number + 1, f"link {number} {name}", word, "not a finite number", "a number")
        row[name] = value or 0.0
    return row
