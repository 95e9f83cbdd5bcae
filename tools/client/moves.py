"""Moves under way, and waiting for them."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Final

from numpy.typing import ArrayLike

from trocar.shm.commands import ENDINGS, became
from trocar.shm.mailbox.messages import Reply
from trocar.shm.time.clock import pause
from trocar.tools.client.callbacks import Callbacks
from trocar.tools.client.deadline import Deadline
from trocar.tools.client.values import numbers
from trocar.tools.client.ways import CommandWay
from trocar.tools.output.errors import Clipped, Refused, Short

POLL_S = 0.002
CLIPPED = "clipped: "
HERE: Final = Path(__file__).parent


class Waits:
    """The waits of one object, in which its callbacks run."""

    def __init__(self, robot_ns: Callable[[], int] | None = None, callbacks: Callbacks | None = None) -> None:
        """`robot_ns`: the robot's time if simulated."""
        self._robot_ns, self._callbacks = robot_ns, callbacks

    def until(self, done: Callable[[], bool], timeout: float, what: str) -> None:
        """Wait for a condition; TimeoutError after `timeout` s, of our time and the robot's: `what` is not so."""
        limit = Deadline(timeout, self._robot_ns)
        if done():
            return
        while not done():
            if self._callbacks is not None:
                self._callbacks.run()
            if limit.is_over():
                raise TimeoutError(f"{what} after {timeout:g} s")
            pause(POLL_S)


class MoveHandle:
    """A move under way."""

    def __init__(self, waits: Waits, remote: CommandWay, first: Reply, what: str) -> None:
        """`first` is the first answer to its command."""
        self._waits, self._remote, self._number, self._what = waits, remote, first.id, what
        self._end = first if first.outcome in ENDINGS else None
        self._accepted = first.text
        self.clipped = first.text.removeprefix(CLIPPED) if first.text.startswith(CLIPPED) else ""
        """Joints with goals beyond their limits, with both values: insertion 5.000 → 0.240 m. Else empty."""
        self.short = ""
        """After the move: joints that are not at their goals, with the difference: 17.2° short (pitch). Else empty."""

    def is_busy(self) -> bool:
        """Whether it still moves; Refused if it ended before its goal. Issues a `Short` warning once."""
        if self._end is None:
            replies = self._remote.replies_to(self._number)
            self._end = next((reply for reply in replies if reply.outcome in ENDINGS), None)
            if self._end is not None and self._end.outcome == "done":
                self.short = self._end.text.removeprefix(self._accepted).removeprefix("; ")
            if self.short:
                warn(f"{self._what} is done, {self.short}", Short)
        if self._end is not None and self._end.outcome != "done":
            raise Refused(f"{self._what} {became(self._end.outcome)}: {self._end.text}")
        return self._end is None

    def wait(self, timeout: float = 30.0, *, is_busy: bool = False) -> None:
        """Wait for its end; TimeoutError after `timeout` s, Refused if the move ended before its goal.

        `is_busy`: wait for the start instead, as in dvrk_python; returns at once, as the move has started.
        """
        if is_busy:
            return
        self._waits.until(lambda: not self.is_busy(), timeout, f"{self._what} is not done")

    def __await__(self) -> Generator[Any, None, None]:
        """`await arm.move_jp(q)`: wait for its end, while other coroutines run; Refused as in `wait`."""
        return self._awaited().__await__()

    async def _awaited(self) -> None:
        import asyncio  # most scripts do without, and it takes a while

        while self.is_busy():
            await asyncio.sleep(POLL_S)


def move(waits: Waits, remote: CommandWay, command: str, values: ArrayLike, text: str = "",
         called: str = "") -> MoveHandle:
    """Send a command that takes time; Refused with the reason. A clipped goal causes a warning (`Clipped`).

    `called`: the word of the script, where that is not the command.
    """
    words = " ".join(word for word in (remote.instance, text, called or command) if word)
    handle = MoveHandle(waits, remote, remote.ask(command, numbers(values), text), words)
    if handle.clipped:
        warn(f"{words} was clipped: {handle.clipped}", Clipped)
    return handle


def warn(text: str, kind: type[Warning]) -> None:
    """Warn, at the line of the script that called us."""
    frame, level = sys._getframe(1), 1
    while Path(frame.f_code.co_filename).parent == HERE and frame.f_back is not None:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, kind, stacklevel=level + 1)
