"""Events as an arm raises them, and commands as it gets them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.command_rows import row_named
from trocar.procs.tables.code_row import Code
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.origins import Origin, SenderId
from trocar.shm.memory.holders import NAMELESS, Holder
from trocar.shm.system.events import SEVERITIES, sentence


@dataclass
class FakeReports:
    """Events as they were raised: (event, …)."""

    events: list[tuple[Any, ...]] = field(default_factory=list)

    def status(self, text: str, component: str = "") -> None:
        self.events.append(("status", text))

    def report(self, code: Code, text: str, component: str = "", axis: int = -1, value: float = 0.0,
               limit: float = 0.0, board: int = -1, has_remedy: bool = False) -> None:
        self.events.append((SEVERITIES[code.severity], code.code, sentence(text, component)))

    def operating_state(self, state: str, sub_state: str, is_homed: bool, is_busy: bool) -> None:
        self.events.append(("operating_state", state, str(sub_state), is_homed, is_busy))

    def goal_reached(self, reached: bool) -> None:
        self.events.append(("goal_reached", reached))

    def emit(self, event: str, text: str = "", *, value: float = 0.0) -> None:
        self.events.append((event, text, value))

    def of(self, *kinds: str) -> list[tuple[Any, ...]]:
        return [e for e in self.events if e[0] in kinds]


PERSON = Origin(1, 0, "test")
PROGRAM = SenderId(0)


@dataclass
class FakeRequest:
    """A command and what became of it."""

    name: str
    values: Any = ()
    text: str = ""
    replies: list[tuple[str, str]] = field(default_factory=list)
    origin: Origin = PERSON
    sender: SenderId = PROGRAM
    pid: int = 4711
    has_client: bool = True
    holder: Holder = NAMELESS
    """The program that its origin names, by default."""

    kind: str = ""

    @property
    def command(self) -> CommandRow:
        return row_named(self.name, self.kind)

    def __post_init__(self) -> None:
        self.values = np.array(self.values, dtype=np.float64)
        if self.holder == NAMELESS:
            self.holder = Holder(self.pid, self.origin.program)

    @property
    def sent_by(self) -> str:
        return self.holder.acting_for(self.origin.program)

    def accept(self, text: str = "") -> None:
        self.replies.append(("accepted", text))

    def refuse(self, reason: str) -> None:
        self.replies.append(("refused", reason))

    def done(self, text: str = "") -> None:
        self.replies.append(("done", text))

    def fail(self, reason: str) -> None:
        self.replies.append(("failed", reason))

    @property
    def outcomes(self) -> list[str]:
        return [outcome for outcome, _ in self.replies]
