"""Processes that are only played, on a clock that is only counted: what the supervisor's logic is tested with."""

from __future__ import annotations

import signal
from dataclasses import dataclass, field

from trocar.procs.document.system import Process
from trocar.procs.supervisor.children import Child


@dataclass
class PlayedProcess:
    """One process at most. It notes what happens to it; a test decides how its setup goes and when it ends."""

    notes: list[str] = field(default_factory=list)
    begun: int = 0
    runs: bool = False
    ready: bool = False
    asked: bool = False
    hangs: bool = False
    stopped: bool = False
    traced: bool = False
    shown_stopped: bool = False
    failure_is_past: bool = False
    lacks_memory: bool = False
    said: str = ""
    _code: int | None = None

    @property
    def pid(self) -> int:
        """Counts up."""
        return 100 + self.begun if self.runs or self._code is not None else 0

    @property
    def is_stopped(self) -> bool:
        """A test stops it."""
        return self.stopped

    def begin(self) -> None:
        """Setup begins."""
        assert not self.runs and self._code is None, "there is one already"
        if self.lacks_memory:
            raise OSError("no memory")
        self.begun, self.runs, self.said = self.begun + 1, True, ""
        self.ready = self.asked = self.hangs = self.traced = False
        self.notes.append("setup")

    def goes_on(self) -> None:
        """It gets some time: setup succeeds, or what was asked is done."""
        if not self.runs or self.hangs:
            return
        if self.asked:
            self.ends(0)
        elif not self.ready:
            self.ready = True
            self.notes.append("main")

    def ends(self, code: int, said: str = "") -> None:
        """It ends; by itself unless a signal ends it."""
        if self.runs:
            self.runs, self.ready, self._code, self.said = False, False, code, said
            self.notes.append("quit" if code >= 0 else "killed")

    def ask_to_end(self) -> None:
        """It does so when it goes on."""
        self.asked = True

    def abort(self) -> None:
        """It ends unless it is stopped."""
        self.traced = not self.stopped
        if not self.stopped:
            self.ends(-signal.SIGABRT)

    def trace(self) -> None:
        """It writes where it is, unless it is stopped, and continues."""
        self.traced = not self.stopped

    def where(self) -> str:
        """As its log has it."""
        return "wall.py line 12 in step" if self.traced else ""

    def kill(self) -> None:
        """It ends whatever it does."""
        self.ends(-signal.SIGKILL)

    def ended(self) -> int | None:
        """As the operating system says it, once."""
        code, self._code = self._code, None
        return code

    def in_words(self, code: int) -> str:
        """How it ended."""
        return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}: {self.said}"

    def show_stopped(self, also_failed: bool = False) -> None:
        """Its page says so."""
        self.shown_stopped, self.failure_is_past = True, also_failed


@dataclass
class Clock:
    """Counted ns."""

    now_ns: int = 1_000_000_000_000

    def passes(self, seconds: float) -> None:
        """Time passes."""
        self.now_ns += round(seconds * 1e9)


@dataclass
class PlayedRequest:
    """A command and its answers."""

    name: str
    text: str
    answers: list[tuple[str, str]] = field(default_factory=list)

    def accept(self, text: str = "") -> None:
        """It is under way."""
        self.answers.append(("accepted", text))

    def refuse(self, reason: str) -> None:
        """It will not be done."""
        self.answers.append(("refused", reason))

    def done(self, text: str = "") -> None:
        """It has been carried out."""
        self.answers.append(("done", text))

    def fail(self, reason: str) -> None:
        """It has failed."""
        self.answers.append(("failed", reason))


def played(name: str, kind: str, clock: Clock, after: tuple[str, ...] = ()) -> tuple[Child, PlayedProcess]:
    """An instance and the process that plays it."""
    process = PlayedProcess()
    return Child(Process(name, kind, 0.001, after), process, lambda: clock.now_ns), process
