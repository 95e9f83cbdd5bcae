"""Enumerated numbers in words: from the field's own text ("0 none, 1 joint, 2 Cartesian: …")."""

from __future__ import annotations

import functools
import re
from typing import Any

from trocar.procs.node.fault_report import fault_of
from trocar.shm.topics import Field

NUMBERED = re.compile(r"(?:^|: |, )0 [^:]*")
PAIR = re.compile(r"(\d+) ([^,:]+)")
FAULT = "a number of the fault table"


@functools.cache
def words_of(text: str) -> dict[int, str]:
    """Numbers and words that a field's text lists; empty: it lists none."""
    found = NUMBERED.search(text)
    words = {int(number): word.strip() for number, word in PAIR.findall(found.group())} if found else {}
    return words if len(words) > 1 else {}  # a single one is a value that means something, no enumeration


def in_words(field: Field, value: Any) -> Any:
    """A value, or a list of them, with words for enumerated numbers."""
    if isinstance(value, list):
        return [in_words(field, each) for each in value]
    if isinstance(value, bool) or not isinstance(value, int):
        return value
    if FAULT in field.text:
        fault = fault_of(value)
        return fault.code if fault is not None else value or "none"
    return words_of(field.text).get(value, value)
