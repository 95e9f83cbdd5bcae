"""The properties of a user's process: values within bounds, published in a topic, saved to a file on request."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from logging import Logger
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.user_process import Property
from trocar.procs.node.node import NodeClock
from trocar.shm.ring.ring import RingWriter


class Properties(Mapping[str, Any]):
    """Numbers and texts by name; a value out of bounds raises ValueError. Each change is published at once."""

    def __init__(self, rows: tuple[Property, ...], ring: RingWriter | None, time: NodeClock) -> None:
        self._rows, self._ring, self._time = {row.name: row for row in rows}, ring, time
        self._values = {row.name: row.first for row in rows}
        self._show()

    def __getitem__(self, name: str) -> Any:
        if name not in self._values:
            raise KeyError(self._none_such(name))
        return self._values[name]

    def _none_such(self, name: str) -> str:
        return f"no property {name}; there are {', '.join(self._rows) or 'none'}"

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __setitem__(self, name: str, value: float | str) -> None:
        if name not in self._rows:
            raise ValueError(self._none_such(name))
        if not self._rows[name].is_text:
            value = float(value)
        if wrong := self._rows[name].objection(value):
            raise ValueError(wrong)
        self._values[name] = value
        self._show()

    def ask(self, text: str, values: NDArray[np.float64]) -> str:
        """Set a property by a command: its name and a number, or name and text. Returns the name."""
        name, _, words = text.partition(" ")
        is_text = name in self._rows and self._rows[name].is_text
        if len(values) != (0 if is_text else 1) or (words and not is_text):
            raise ValueError(f"{name} takes a text, and no number" if is_text else "it takes one number")
        self[name] = words if is_text else float(values[0])
        return name

    def _show(self) -> None:
        if self._ring is not None:
            for name, value in self._values.items():
                self._ring.field(name)[...] = value.encode() if isinstance(value, str) else value
            self._ring.publish(max(self._time.now_ns(), self._ring.stamp_ns + 1))

    def save(self, path: Path) -> None:
        """Save all values for the next start."""
        path.write_text(json.dumps(self._values), encoding="utf-8")

    def load(self, path: Path, log: Logger) -> None:
        """Load saved values of existing properties; the first one out of bounds ends that, with a warning."""
        try:
            saved = json.loads(path.read_text(encoding="utf-8"))
            for name in [name for name in self if name in saved]:
                self[name] = saved[name]
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError) as error:
            log.warning("%s: some of it is ignored: %s", path, error)
