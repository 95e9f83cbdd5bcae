"""Commands to one component, and their outcomes.

Waits for an answer are limited in the system's time and in ours: on a busy machine a process that lacks a core, or
waits for one that does, may answer late in simulated time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from trocar.shm.commands import ENDINGS, became
from trocar.shm.mailbox.client import Client, MailboxFull, Reply
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.deadline import Deadline
from trocar.tools.inspect.messages import in_full
from trocar.tools.output.errors import Problem, Refused, closed
from trocar.tools.systems.find import alive, orphaned

POLL_S = 0.001
START_S = 2.0
SILENT_NS = 300_000_000
STARTING = ("CREATED", "STARTING")
NO_ANSWER = "did not answer {} within {:g} s; is it running? (trocar status)"
ENDED = {"STOPPED": "is not running", "FAILED": "has failed"}


class Remote(Client, Closable):
    """A handle to the mailbox of one component that waits for answers; a context manager."""

    def __init__(self, system: str, instance: str) -> None:
        """Attach; SegmentError if there is no such component."""
        super().__init__(system, instance)
        self._system = system
        self._time, self._page = SystemTime(system), ControlPage(system, instance)

    @property
    def is_starting(self) -> bool:
        """Whether it still starts: it refuses commands sent before it ran."""
        return self._page.state in STARTING

    def wait_until_it_runs(self) -> None:
        """Wait while it starts.

        Problem if it has been stopped, has failed, or has crashed and has no supervisor to restart it.
        """
        deadline = Deadline(START_S)
        while self.is_starting and not deadline.is_over():
            pause(POLL_S)
        state = self._page.state
        self._check_supervisor(state in ENDED)
        if state in ENDED:
            raise Problem(f"{self.instance} {ENDED[state]}; trocar status says why, trocar start {self.instance} "
                          "starts it")

    def _check_supervisor(self, is_dead: bool = False) -> None:
        """Problem if the process has crashed, and no supervisor restarts it.

        Makes system calls only after a silence, not for each goal of a stream.
        """
        silent_ns = monotonic_ns() - int(self._page.get("heartbeat_ns"))
        is_dead = is_dead or (silent_ns > SILENT_NS and not alive(self._page.segment.identity()))
        if is_dead and (lost := orphaned(self._system)):
            raise Problem(lost)

    def replies(self) -> list[Reply]:
        """Answers to all commands that were not collected yet."""
        return [self._in_full(reply) for reply in self.poll()]

    def replies_to(self, number: int) -> list[Reply]:
        """Answers to one command that were not collected yet."""
        return [self._in_full(reply) for reply in super().replies_to(number)]

    def _in_full(self, reply: Reply) -> Reply:
        return replace(reply, text=in_full(self._system, self.instance, reply.text))

    def answered(self, command: str, values: Any = (), text: str = "", timeout: float = 2.0) -> Reply:
        """Send and wait for the first answer: accepted, refused, done or failed; Problem if there is none."""
        return self._reply_to(self.post(command, values, text), command, timeout, ())

    def settled(self, command: str, values: Any = (), text: str = "", timeout: float = 60.0) -> Reply:
        """Send and wait for the end: refused, done or failed; Problem if it does not arrive in time."""
        return self._reply_to(self.post(command, values, text), command, timeout, ENDINGS)

    def ask(self, command: str, values: Any = (), text: str = "", timeout: float = 2.0) -> Reply:
        """Send and make sure that it was accepted: Refused carries the reason. Returns the first answer."""
        reply = self.answered(command, values, text, timeout)
        if reply.outcome not in ("accepted", "done"):
            raise Refused(reply.text or f"{self.instance}: {command} {became(reply.outcome)}")
        return reply

    def post(self, command: str, values: Any = (), text: str = "") -> int:
        """Send once it runs, returns its number; Problem if it cannot be sent."""
        self.wait_until_it_runs()
        try:
            return self.send(command, values, text)
        except (SegmentError, MailboxFull) as error:
            raise Problem(str(error)) from None
        except KeyError:
            raise Problem(f"{self.instance} has no command {command}") from None

    def _reply_to(self, number: int, command: str, timeout: float, wanted: tuple[str, ...]) -> Reply:
        deadline = Deadline(timeout, self._time.now_ns if self._time.simulated else None)
        last: Reply | None = None
        is_over = False
        while not is_over:
            is_over = deadline.is_over()  # before the look: after a stall, look once more
            replies = self.replies_to(number)
            for i, reply in enumerate(replies):
                last = reply
                if not wanted or reply.outcome in wanted:
                    with self._place.lock:  # another thread may take answers from this handle
                        self.inbox[:0] = replies[i + 1 :]
                    return reply
            if not is_over:
                self._check_supervisor()
                pause(POLL_S)
        if last is not None:
            raise Problem(f"{self.instance}: {command} was {last.outcome}, but is not done after {timeout:g} s")
        raise Problem(f"{self.instance} {NO_ANSWER.format(command, timeout)}")

    def close(self) -> None:
        """Detach; the last one of a process frees its place."""
        super().close()
        self._time.close()
        self._page.close()
        self._place = self._time = self._page = closed(self.instance)
