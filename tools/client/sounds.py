"""What a whole system can be asked besides power: sounds; and what it reports."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, Final, Self

from trocar.shm.memory.header import SegmentError
from trocar.tools.client.callbacks import Callbacks, Reporting
from trocar.tools.client.ways import RowWay, Ways
from trocar.tools.output.errors import Problem

WHOLE: Final = "system"
"""The process that brings all arms up, repeats what all report and makes sounds, where there are consoles."""


class Sounds(Reporting):
    """Of a running system; a context manager."""

    def __init__(self, ways: Ways) -> None:
        """Nothing is asked yet."""
        self._ways, self.name = ways, ways.name
        self._rows: RowWay | None = None
        self._callbacks = Callbacks(ways.events(WHOLE), self._row)

    def set_volume(self, volume: float) -> None:
        """Of beeps and speech, 0 to 1."""
        self._ask("set_volume", (volume,))

    def volume(self) -> float:
        """The same."""
        return float(self._row()["volume"])

    def beep(self, duration: float = 0.3, frequency: float = 3000.0, volume: float | None = None) -> None:
        """Make a beep: s, Hz, 0 to 1; at the system's volume unless told otherwise."""
        self._ask("beep", (duration, frequency) if volume is None else (duration, frequency, volume))

    def string_to_speech(self, text: str) -> None:
        """Say it."""
        self._ask("string_to_speech", text=text)

    def _ask(self, command: str, values: Sequence[float] = (), text: str = "") -> None:
        self._row()
        with contextlib.closing(self._ways.remote(WHOLE)) as remote:
            remote.ask(command, values, text)

    def _row(self) -> Mapping[str, Any]:
        try:
            if self._rows is None:
                self._rows = self._ways.rows(WHOLE)
        except (SegmentError, Problem) as error:
            raise Problem(f"{self.name} has no process {WHOLE}, as systems with a console have: {error}") from None
        return self._rows.row()

    def close(self) -> None:
        """Detach."""
        self._callbacks.close()
        if self._rows is not None:
            self._rows.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
