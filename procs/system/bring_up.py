"""The arms of a system by their records, and their bring-up to a common goal: powered on, homed or off.

All arms proceed at the same time, each at its own pace. An arm in FAULT is disabled first and must show DISABLED
before it is enabled; only an arm that shows ENABLED is homed. Each step has its own time limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.node.inputs import Input
from trocar.procs.node.runtime import Node
from trocar.procs.tables.bring_up import DISABLE, ENABLE, HOME, LIMITS_S, next_word, reached
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.origins import Origin

POWER_ON, POWER_OFF = "power_on", "power_off"
WORDS: Final = {POWER_ON: ENABLE, "home": HOME, POWER_OFF: DISABLE}

LATE_S: Final = 0.1
ENABLED, FAULT = "ENABLED", "FAULT"


class ArmOnRing:
    """One arm, or the setup joints of a cart, by its record and mailbox."""

    def __init__(self, name: str, record: Input, client: LoopClient) -> None:
        """The state is unknown until `look`."""
        self.name = name
        self._record, self._client = record, client
        self._fields = {key: record.field(key) for key in ("state", "is_homed", "is_busy", "reason")}
        self.state, self.is_homed, self.is_busy, self.is_fresh = "", False, False, False
        self.reason = ""
        self.refusals: list[str] = []
        """Refusals of the last command."""
        self._asked = 0

    def look(self, now_ns: int) -> None:
        """Read its newest record and its answers."""
        self.is_fresh = self._record.look(now_ns) and self._record.fresh
        if self.is_fresh:
            self.state = self._fields["state"].item().decode()
            self.reason = self._fields["reason"].item().decode(errors="replace")
            self.is_homed, self.is_busy = bool(self._fields["is_homed"]), bool(self._fields["is_busy"])
        self.refusals += [reply.text for reply in self._client.poll()
                          if reply.id == self._asked and reply.outcome in ("refused", "failed")]

    def ask(self, word: str, origin: Origin) -> bool:
        """Send a state_command on behalf of its origin; False if it cannot be sent."""
        self.refusals.clear()
        self._client.on_behalf(origin)
        self._asked = self._client.send("state_command", (), word)
        return bool(self._asked)


def arms_of(node: Node) -> Sequence[ArmOnRing]:
    """All arms of the system in start order, then setup joints."""
    return [ArmOnRing(row.name, node.input(row.name, late_s=LATE_S), node.commands(row.name))
            for rows in (node.document.arms, node.document.carts) for row in rows]


class Step:
    """The bring-up of one arm; `problem` is the reason if it cannot reach the goal."""

    def __init__(self, arm: ArmOnRing, goal: str, now_ns: int, origin: Origin) -> None:
        """Begin at once."""
        self.arm, self.goal, self._origin = arm, goal, origin
        self.problem, self.is_there = "", False
        self._asked: list[str] = []
        self._deadline_ns = now_ns + round(LIMITS_S[DISABLE] * 1e9)
        arm.refusals.clear()  # of earlier commands

    @property
    def is_over(self) -> bool:
        """Whether it has reached the goal, or failed."""
        return self.is_there or bool(self.problem)

    def step(self, now_ns: int) -> None:
        """Check the arm, and send the next command once."""
        if self.is_over:
            return
        arm = self.arm
        if arm.is_fresh and self._reached():
            self.is_there = True
        elif arm.refusals:
            self.problem = arm.refusals[-1]
        elif arm.is_fresh and (word := self._next()) and word not in self._asked:
            if arm.ask(word, self._origin):
                self._asked.append(word)
                self._deadline_ns = now_ns + round(LIMITS_S[word] * 1e9)
        elif arm.is_fresh and arm.state == "FAULT" and "enable" in self._asked:
            self.problem = f"went to FAULT: {arm.reason}" if arm.reason else "went to FAULT"
        elif now_ns >= self._deadline_ns:
            why = f": waits: {arm.reason}" if arm.reason else ""
            self.problem = f"is still {arm.state or 'without a state'}{why}" if arm.is_fresh else "does not answer"

    def _reached(self) -> bool:
        arm = self.arm
        reported = self.goal != POWER_OFF or DISABLE in self._asked
        return reported and reached(WORDS[self.goal], arm.state, arm.is_homed, arm.is_busy)

    def _next(self) -> str:
        """The next word; also for an arm that is already enabling, so that it follows this command from now on."""
        if self.arm.state == "FAULT" and ENABLE in self._asked:
            return ""
        return next_word(WORDS[self.goal], self.arm.state)


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
