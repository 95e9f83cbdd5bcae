"""A whole system: commands to it and its reports, and access to one on another machine."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final

from trocar.procs.tables import bring_up as rule
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.procs.tables.bring_up import DISABLED, ENABLED, HOMED
from trocar.shm.commands import became
from trocar.shm.memory.header import SegmentError
from trocar.tools.client.callbacks import Callbacks, Reporting
from trocar.tools.client.deadline import is_timeout, seconds
from trocar.tools.client.distant import DistantWays
from trocar.tools.client.moves import CLIPPED, warn
from trocar.tools.client.ways import RecordWay, Ways
from trocar.tools.output.errors import Clipped, Problem

WHOLE: Final = "system"
"""The process that brings all arms up, repeats their reports and makes sounds."""
REPLY_S: Final = 2.0
WORDS: Final = {ENABLED: "power_on", HOMED: "home", DISABLED: "power_off"}


class WholeSystem(Reporting, ABC):
    """A running system; a context manager."""

    def __init__(self, ways: Ways) -> None:
        """Sends nothing yet."""
        self._ways, self.name = ways, ways.name
        self._record: RecordWay | None = None
        self._callbacks = Callbacks(ways.events(WHOLE), self._row)

    def power_on(self, timeout: float = 10.0) -> None:
        """Enable every arm, and the setup joints; Problem names the failed ones with reasons."""
        self._bring(ENABLED, seconds(timeout))

    def home(self, timeout: float = 60.0) -> None:
        """Home every arm, enabling those that are not."""
        self._bring(HOMED, seconds(timeout))

    def power_off(self, timeout: float = 10.0) -> None:
        """Disable every arm. An invalid timeout raises ValueError only after that."""
        self._bring(DISABLED, timeout if is_timeout(timeout) else 0.0)
        seconds(timeout)

    @abstractmethod
    def _bring(self, goal: str, timeout: float) -> None:
        """Bring every arm to this goal."""

    def set_volume(self, volume: float) -> None:
        """Set the volume of beeps and speech, 0 to 1."""
        self._ask("set_volume", (volume,))

    def volume(self) -> float:
        """The volume of beeps and speech, 0 to 1."""
        return float(self._row()["volume"])

    def beep(self, duration: float = 0.3, frequency: float = 3000.0, volume: float | None = None) -> None:
        """Beep: duration in s, frequency in Hz, volume 0 to 1 (default: the system's volume)."""
        self._ask("beep", (duration, frequency) if volume is None else (duration, frequency, volume))

    def string_to_speech(self, text: str) -> None:
        """Say this text."""
        self._ask("string_to_speech", text=text)

    def _ask(self, command: str, values: Sequence[float] = (), text: str = "") -> None:
        self._row()
        with contextlib.closing(self._ways.remote(WHOLE)) as remote:
            reply = remote.ask(command, values, text)
        if reply.text.startswith(CLIPPED):
            warn(f"{WHOLE} {command} was {reply.text}", Clipped)

    def _row(self) -> Mapping[str, Any]:
        try:
            if self._record is None:
                self._record = self._ways.record(WHOLE)
        except (SegmentError, Problem) as error:
            raise Problem(f"{self.name} has no process {WHOLE}: {error}") from None
        return self._record.row()

    def close(self) -> None:
        """Detach."""
        self._callbacks.close()
        if self._record is not None:
            self._record.close()


class DistantSystem(WholeSystem):
    """A system on another machine, through its socket bridge; a context manager."""

    def __init__(self, ways: DistantWays) -> None:
        """Closed with us."""
        super().__init__(ways)
        self._distant = ways

    def arms(self) -> list[str]:
        """Names of its arms."""
        return [name for name, what in self._distant.instances.items() if what in ARM_TYPES]

    def _bring(self, goal: str, timeout: float) -> None:
        reply = self._distant.remote(WHOLE).settled(
            WORDS[goal], timeout=timeout or rule.most_s(rule.WORDS[goal]) + REPLY_S)
        if reply.outcome != "done":
            raise Problem(f"{WORDS[goal]} {became(reply.outcome)}: {reply.text}")

    def close(self) -> None:
        """Leave."""
        super().close()
        self._distant.connection.close()
