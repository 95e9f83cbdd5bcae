"""Traces: what a part does in a long play of inputs, compared line by line with a file beside its test.

A play is drawn with a fixed seed from what may happen to the part. It comes to corners of its state space that nobody
writes a test for, and what the part does there changes on purpose only: TROCAR_NEW_TRACES=1 writes the files anew, and
what has changed in them is read before it is committed.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np

DIGITS: Final = 6
AT_ONCE: Final = 2
ZERO: Final = 1e-9  # what rounding leaves of a zero differs between machines


def shown(value: Any) -> str:
    """A value as traces have it: numbers with six digits, arrays in brackets, texts without their padding."""
    if isinstance(value, np.ndarray) and value.shape:
        return f"[{' '.join(shown(item) for item in value)}]"
    if isinstance(value, np.ndarray | np.generic):
        value = value.item()
    if isinstance(value, bytes):
        return value.decode(errors="replace") or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "0" if abs(value) < ZERO else f"{value:.{DIGITS}g}"
    if isinstance(value, tuple | list):
        return f"({' '.join(shown(item) for item in value)})"
    return str(value)


class Trace:
    """Lines of a play: what happened, and of what can be seen what has changed since the last `look`."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._seen: dict[str, str] = {}
        self._raw: dict[str, object] = {}
        self._last: tuple[str, ...] = ()
        self._times = 0

    def look(self, did: Iterable[str], seen: Iterable[tuple[str, Any]]) -> None:
        """One step: what was done in it, and how things are after it; steps that are the same make one line."""
        lines = list(did)
        for name, value in seen:
            raw = value.tobytes() if isinstance(value, np.ndarray) else repr(value)
            if self._raw.get(name) == raw:  # to put it into words takes ten times as long
                continue
            self._raw[name] = raw
            text = shown(value)
            if self._seen.get(name) != text:
                self._seen[name] = text
                lines.append(f"{name} {text}")
        step = tuple(lines)
        if step == self._last:
            self._times += 1
            return
        self._finish()
        self._last, self._times = step, 1

    def _finish(self) -> None:
        if self._last:
            self.lines.append(f"{self._times}x {'; '.join(self._last)}")

    def compare(self, file: Path) -> None:
        """Nothing may differ from the file."""
        self._finish()
        self._last = ()
        if os.environ.get("TROCAR_NEW_TRACES"):
            file.write_text("".join(f"{line}\n" for line in self.lines), encoding="utf-8")
        before = file.read_text(encoding="utf-8").splitlines()
        for number, (was, now) in enumerate(itertools.zip_longest(before, self.lines, fillvalue="the end"), 1):
            assert was == now, f"{file.name}, line {number}; if that is wanted, run the test with TROCAR_NEW_TRACES=1"


class Mishaps:
    """What disturbs a play for a while: pairs of what brings it about and what ends it, two at a time at most."""

    def __init__(self, chance: Random, pairs: Sequence[tuple[Callable[[], object], Callable[[], object]]], *,
                 often: float, longest: int) -> None:
        """`often`: the share of steps in which one begins; it lasts for up to `longest` steps."""
        self._chance, self._pairs, self._often, self._longest = chance, pairs, often, longest
        self._ends: list[tuple[int, Callable[[], object]]] = []

    def step(self) -> None:
        """Begin or end some."""
        going = [(left - 1, end) for left, end in self._ends]
        self._ends = [(left, end) for left, end in going if left > 0]
        for left, end in going:
            if left <= 0:
                end()
        if len(self._ends) < AT_ONCE and self._chance.random() < self._often:
            begin, end = self._chance.choice(self._pairs)
            self._ends.append((self._chance.randint(1, self._longest), end))
            begin()
