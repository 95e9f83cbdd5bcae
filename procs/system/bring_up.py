"""The arms of a system by their records, and their bring-up to a common goal: powered on, homed or off.

All arms proceed at the same time, each at its own pace. Each step has its own time limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.node.inputs import Input
from trocar.procs.node.node import Node
from trocar.procs.tables.bring_up import DISABLE, ENABLE, HOME, LIMITS_S, late, next_word, obstacle, reached
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.origins import Origin

POWER_ON, POWER_OFF = "power_on", "power_off"
WORDS: Final = {POWER_ON: ENABLE, "home": HOME, POWER_OFF: DISABLE}

LATE_S: Final = 0.1
ENABLED, FAULT = "ENABLED", "FAULT"


class ArmOnRing:
    """One arm, or the setup joints of a cart, by its record and mailbox."""

    def __init__(self, name: str, record: Input, client: LoopClient, *, holds: bool) -> None:
        """The state is unknown until `look`; `holds`: it has the command `hold`."""
        self.name, self._holds = name, holds
        self._record, self._client = record, client
        self._fields = {key: record.field(key) for key in ("state", "is_homed", "is_busy", "reason")}
        self.state, self.is_homed, self.is_busy, self.is_fresh = "", False, False, False
        self.reason, self.is_done = "", False
        self.refusals: list[str] = []
        """Refusals of the last command; `is_done`: the arm has confirmed that it is carried out."""
        self._asked = 0

    def look(self, now_ns: int) -> None:
        """Read its newest record and its answers."""
        self.is_fresh = self._record.look(now_ns) and self._record.fresh
        if self.is_fresh:
            self.state = self._fields["state"].item().decode()
            self.reason = self._fields["reason"].item().decode(errors="replace")
            self.is_homed, self.is_busy = bool(self._fields["is_homed"]), bool(self._fields["is_busy"])
        for reply in self._client.poll():
            if reply.id == self._asked:
                self.is_done |= reply.outcome == "done"
                self.refusals += [reply.text] * (reply.outcome in ("refused", "failed"))

    def ask(self, word: str, origin: Origin) -> bool:
        """Send a state_command on behalf of its origin; False if it cannot be sent."""
        self.refusals, self.is_done = [], False
        self._client.on_behalf(origin)
        self._asked = self._client.send("state_command", (), word)
        return bool(self._asked)

    def hold(self, origin: Origin) -> bool:
        """Stop it, after all that was asked of it; False if it cannot be sent. Setup joints are moved by hand only."""
        self._client.on_behalf(origin)
        return not self._holds or bool(self._client.send("hold"))


def arms_of(node: Node) -> Sequence[ArmOnRing]:
    """All arms of the system in start order, then setup joints."""
    document = node.document
    return [ArmOnRing(row.name, node.input(row.name, late_s=LATE_S), node.commands(row.name),
                      holds=rows is document.arms)
            for rows in (document.arms, document.carts) for row in rows]


class Step:
    """The bring-up of one arm; `problem` is the reason if it cannot reach the goal."""

    def __init__(self, arm: ArmOnRing, goal: str, now_ns: int, origin: Origin) -> None:
        """Begin at once."""
        self.arm, self._word, self._origin = arm, WORDS[goal], origin
        self.problem, self.is_there, self._asked = "", False, ""
        self._deadline_ns = now_ns + round(LIMITS_S[""] * 1e9)
        arm.refusals.clear()  # of earlier commands

    @property
    def is_over(self) -> bool:
        """Whether it has reached the goal, or failed."""
        return self.is_there or bool(self.problem)

    def step(self, now_ns: int) -> None:
        """Check the arm, and send the next command once."""
        if self.is_over:
            return
        arm, aim = self.arm, (self._word, self._asked)
        state = arm.state if arm.is_fresh else ""
        if reached(*aim, arm.is_done, state, arm.is_homed, arm.is_busy):
            self.is_there = True
        elif problem := (arm.refusals[-1] if arm.refusals else obstacle(*aim, state, arm.name, arm.reason)):
            self.problem = problem
        elif (word := next_word(*aim, state)) and arm.ask(word, self._origin):
            self._asked, self._deadline_ns = word, now_ns + round(LIMITS_S[word] * 1e9)
        elif now_ns >= self._deadline_ns:
            self.problem = late(self._word, state, "", arm.reason, "it does not answer")


class BringUp:
    """The bring-up of all arms to one goal."""

    def __init__(self, goal: str, arms: Sequence[ArmOnRing], now_ns: int, origin: Origin) -> None:
        """Begin at once; `origin` is the operator's command behind it, which any later fault invalidates."""
        self.goal = goal
        self._steps = [Step(arm, goal, now_ns, origin) for arm in arms]

    def step(self, now_ns: int) -> None:
        """One cycle for all arms."""
        for one in self._steps:
            one.step(now_ns)

    @property
    def is_over(self) -> bool:
        """Whether every arm has reached the goal or failed."""
        return all(one.is_over for one in self._steps)

    @property
    def waiting(self) -> str:
        """The arms that are still under way, in words."""
        left = [f"{one.arm.name} ({one.arm.state or 'silent'}{f': {one.arm.reason}' if one.arm.reason else ''})"
                for one in self._steps if not one.is_over]
        return f"waiting for {', '.join(left)}" if left else ""

    @property
    def problems(self) -> str:
        """The arms that failed, with reasons; empty if none has."""
        return "; ".join(f"{one.arm.name}: {one.problem.removeprefix(f'{one.arm.name}: ')}"
                         for one in self._steps if one.problem)
