"""Common parts of arms and setup joints: an operating state, and commands that change it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from trocar.procs.crtk.names import none_such
from trocar.procs.tables.bring_up import DISABLED, ENABLED, HOMED
from trocar.shm.mailbox.command_row import of_type
from trocar.tools.client.callbacks import Callbacks, Reporting
from trocar.tools.client.deadline import is_timeout, seconds
from trocar.tools.client.moves import Waits
from trocar.tools.client.ways import RecordWay, Ways

STATES: Final = ("DISABLED", "ENABLED", "PAUSED", "FAULT")


def known_state(state: str, states: Iterable[str] = STATES) -> None:
    """ValueError unless that is one of the `states`, default those of an arm."""
    if state not in states:
        raise ValueError(f"{state!r} is not a state; allowed: {', '.join(states)}")


class InstanceHandle(Reporting):
    """A script's handle for one instance of a running system. Each thread must make its own."""

    def __init__(self, ways: Ways, name: str, *, reports_fields: bool = False) -> None:
        """Attach; Problem or SegmentError if it is not there (yet). `reports_fields`: changes of its record are events.
        """
        self._ways, self.name, self.system = ways, name, ways.name
        self._record: RecordWay = ways.record(name)
        with contextlib.ExitStack() as stack:
            stack.callback(self._record.close)
            self._remote = ways.remote(name)
            stack.callback(self._remote.close)
            self._callbacks = Callbacks(ways.events(name), self._record.row if reports_fields else None)
            stack.callback(self._callbacks.close)
            self._open = stack.pop_all()
        self._waits = Waits(self._record.stamp_ns if ways.is_simulated else None, self._callbacks)

    def connected(self) -> bool:
        """Whether it shows fresh records."""
        return self._record.is_fresh()

    def check_connections(self, timeout: float = 5.0) -> None:
        """TimeoutError unless it shows fresh records within `timeout` s."""
        self._waits.until(self.connected, timeout, f"{self.name} is not connected")

    def close(self) -> None:
        """Detach; the instance continues its work."""
        self._open.close()


class Instance(InstanceHandle):
    """One arm, or set of setup joints, of a running system; a context manager. Each thread has to make its own."""

    if not TYPE_CHECKING:  # for names that are unknown before runtime

        def __getattr__(self, name: str) -> Callable[..., str]:
            """Any other command, called by its name with _ for /; arguments: arrays and numbers, then the text.

            The call returns the answer; Refused carries the reason.
            """
            if name.startswith("_"):
                raise AttributeError(name)
            for row in self._remote.commands:
                if str(row["name"]).replace("/", "_") == name and self._has(row):
                    return partial(self._command, str(row["name"]))
            raise AttributeError(none_such("command", name, self._words(), self.name))

    def _has(self, row: dict[str, Any]) -> bool:
        """Whether its type has this command; most commands are those of all types."""
        return "types" not in row or bool(of_type([row], self._ways.type_of(self.name)))

    def _words(self) -> list[str]:
        """All that can be called, methods and commands of its type."""
        rows = of_type(self._remote.commands, self._ways.type_of(self.name))
        own = {name for name in dir(type(self)) if not name.startswith("_")}
        return sorted(own.union(str(row["name"]).replace("/", "_") for row in rows))

    def _command(self, command: str, *arguments: ArrayLike | str) -> str:
        words = [each for each in arguments if isinstance(each, str)]
        given = [np.ravel(np.asarray(each, float)) for each in arguments if not isinstance(each, str)]
        return self._remote.ask(command, np.concatenate(given) if given else (), " ".join(words)).text

    def operating_state(self) -> tuple[str, int]:
        """DISABLED, ENABLED, PAUSED or FAULT."""
        watch = self._record.look()
        return watch.state, watch.stamp_ns

    def desired_state(self) -> tuple[str, int]:
        """The requested state."""
        watch = self._record.look()
        return watch.text("desired_state"), watch.stamp_ns

    def is_enabled(self) -> bool:
        """Whether the arm is powered and not paused."""
        return self._record.look().state == "ENABLED"

    def is_disabled(self) -> bool:
        """Whether the arm has no power, or is on the way to it."""
        return self._record.look().state == "DISABLED"

    def is_homed(self) -> bool:
        """Whether the arm is homed and powered."""
        return self._record.look().homed

    def is_busy(self) -> bool:
        """Whether a move or a transition is in progress."""
        return self._record.look().busy

    def wait_for_operating_state(self, state: str, timeout: float = 10.0) -> None:
        """Wait until it is DISABLED, ENABLED, PAUSED or FAULT; TimeoutError after `timeout` s."""
        known_state(state)
        self._waits.until(lambda: self._record.look().state == state, timeout, f"{self.name} is not {state}")

    def wait_for_busy(self, is_busy: bool = False, timeout: float = 30.0) -> None:
        """Wait until it is busy, or no longer busy; TimeoutError after `timeout` s."""
        how = "not" if is_busy else "still"
        self._waits.until(lambda: self.is_busy() == is_busy, timeout, f"{self.name} is {how} busy")

    def state_command(self, word: str) -> None:
        """Send enable, disable, home, unhome, pause or resume; Refused if it is not allowed now."""
        self._remote.ask("state_command", text=word)

    def enable(self, timeout: float = 10.0) -> None:
        """Power on and wait until done; Problem gives the reason for a failure."""
        self._ways.bring(self.name, ENABLED, seconds(timeout))

    def disable(self, timeout: float = 10.0) -> None:
        """Power off and wait until done. An invalid timeout raises ValueError only after that."""
        self._ways.bring(self.name, DISABLED, timeout if is_timeout(timeout) else 0.0)
        seconds(timeout)

    def home(self, timeout: float = 60.0) -> None:
        """Enable if needed, home, and wait until it is homed."""
        self._ways.bring(self.name, HOMED, seconds(timeout))

    def unhome(self, timeout: float = 10.0) -> None:
        """Clear the homing and wait until it is cleared."""
        self.state_command("unhome")
        self._waits.until(lambda: not self.is_homed(), timeout, f"{self.name} is still homed")

    def period_statistics(self) -> dict[str, dict[str, float]]:
        """avg, std, min, max and p99 (s) of the `period` and the `work` of its loop, in its last full second."""
        return self._ways.statistics(self.name)
