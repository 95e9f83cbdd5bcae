"""Arms brought to a state through their `state_command`, several at a time: enabled, homed or disabled.

Faulty arms are disabled first. Success is checked in the arms' own state records, power-off in io's.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from trocar.procs.tables.bring_up import (
    DISABLE,
    DISABLED,
    ENABLE,
    HOME,
    LIMITS_S,
    WORDS,
    next_word,
    reached,
)
from trocar.shm.mailbox.client import begin
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.deadline import Deadline
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import Amplifiers, Watch, powered_names
from trocar.tools.output.errors import Problem, Refused
from trocar.tools.output.printing import Say
from trocar.tools.systems.find import is_simulated, orphaned

POLL_S = 0.02
CONTINUES = {HOME: "arms may move", ENABLE: "arms may still get power", DISABLE: "arms may still lose power"}
PATIENCE_NS = 1_000_000_000  # a shorter wait is not reported
Report = Callable[[str], None]


def silent(*_: object) -> None:
    """Progress, or news, that is not shown."""


@dataclass(slots=True)
class ArmBringUp:
    """One arm on its way to a goal; `step` until `over`."""

    watch: Watch
    remote: Remote
    amplifiers: Amplifiers
    goal: str
    limit_s: float
    simulated: bool
    over: bool = False
    problem: str = ""
    asked: list[str] = field(default_factory=list)
    _deadline: Deadline | None = None
    _waits: str = ""
    _reported: str = ""
    _since_ns: int = 0

    def step(self) -> None:
        """Look, and send the next command once."""
        if not self.watch.look():
            self._check_time(self.watch.problem() or "it has not shown its state")
            return
        state, busy = self.watch.state, self.watch.busy
        if reached(WORDS[self.goal], state, self.watch.homed, busy):
            problem = self.watch.problem()  # the record of a crashed or hanging process stays unchanged
            problem = problem or (self.amplifiers.why_not_off() if self.goal == DISABLED else "")
            if problem:
                self._check_time(problem)
            else:
                self.over = True
        elif state == "FAULT" and self.asked and self.asked[-1] != "disable":
            self._fail(self.watch.last_error() or "it went to FAULT without a reason")
        else:
            word = self._next_word(state, busy)
            if word and word not in self.asked:
                self._ask(word)
            else:
                waits, inner = self.waits, self.watch.text("sub_state")
                shown = state if inner in ("", state) else f"{state} ({inner})"
                self._check_time(f"it waits: {waits}" if waits else f"it is {shown}")

    def _next_word(self, state: str, busy: bool) -> str:
        word = next_word(WORDS[self.goal], state)
        if state == "PAUSED" and word != DISABLE:
            self._fail(f"it is PAUSED; first: trocar send {self.watch.name} state_command resume")
        return "" if word == ENABLE and busy else word

    def _ask(self, word: str) -> None:
        self.asked.append(word)
        self._deadline = self._limit(word)
        self.watch.forget_errors()
        try:
            self.remote.ask("state_command", text=word)
        except Refused as refusal:
            self._fail(f"{word} was refused: {refusal}")
        except Problem as problem:
            self._fail(str(problem))

    def _limit(self, word: str) -> Deadline:
        return Deadline(self.limit_s or LIMITS_S[word], (lambda: self.watch.stamp_ns) if self.simulated else None)

    def _check_time(self, how: str) -> None:
        if self.watch.problem() and (lost := orphaned(self.watch.system)):
            self._fail(lost)
            return
        self._deadline = self._deadline or self._limit(WORDS[self.goal])
        if self._deadline.is_over():
            error = self.watch.last_error()
            known = f": {error}" if error and not how.startswith("it waits") else ""
            self._fail(f"not {self.goal} in time; {how}{known}")

    def _fail(self, why: str) -> None:
        self.over, self.problem = True, why.removeprefix(f"{self.watch.name}: ")

    @property
    def waits(self) -> str:
        """The condition the arm waits for, in its own words; empty: none."""
        return "" if self.watch.state == "FAULT" else self.watch.text("reason")

    def line(self) -> str:
        """The arm in a word or two, for a progress line."""
        return f"{self.watch.name} {self.watch.text('sub_state') or self.watch.state}"

    def news(self, now_ns: int) -> str:
        """Report for a person: the condition it has waited for for a second by now; empty: nothing new."""
        waits = "" if self.over else self.waits
        if waits != self._waits:
            self._waits, self._since_ns = waits, now_ns
        if not waits or waits == self._reported or now_ns - self._since_ns < PATIENCE_NS:
            return ""
        self._reported = waits
        return f"{self.watch.name} waits: {waits}"


def bring(system: str, names: Sequence[str], goal: str, limit_s: float, say: Say,
          report: Report = silent) -> dict[str, str]:
    """Bring arms to `goal` (enabled, homed, disabled) at the same time; returns the problem of each, empty: done.

    All its steps are one command: no step is carried out after a fault. `report` receives the condition that an arm
    waits for, once it has waited for a second.
    """
    simulated, whole = is_simulated(system), begin(system)
    with contextlib.ExitStack() as stack:
        bring_ups = [
            ArmBringUp(stack.enter_context(Watch(system, name)), stack.enter_context(Remote(system, name)),
                       stack.enter_context(Amplifiers(system, name)), goal, limit_s, simulated)
            for name in names
        ]
        for bring_up in bring_ups:
            bring_up.remote.on_behalf(whole)
        try:
            while not all(bring_up.over for bring_up in bring_ups):
                for bring_up in bring_ups:
                    if not bring_up.over:
                        bring_up.step()
                for news in filter(None, [bring_up.news(monotonic_ns()) for bring_up in bring_ups]):
                    report(news)
                done = sum(bring_up.over for bring_up in bring_ups) / len(bring_ups)
                say(", ".join(bring_up.line() for bring_up in bring_ups), done)
                pause(POLL_S)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(_left(bring_ups)) from None
        return {bring_up.watch.name: bring_up.problem for bring_up in bring_ups}


def _left(bring_ups: Sequence[ArmBringUp]) -> str:
    """The effect of ending the wait before every arm has received its last command; empty: every arm has it."""
    under_way = [bring_up for bring_up in bring_ups if not bring_up.over]
    last = {bring_up.asked[-1] for bring_up in under_way if bring_up.asked}
    missed = [bring_up.watch.name for bring_up in under_way if WORDS[bring_up.goal] not in bring_up.asked]
    effects = [text for word, text in CONTINUES.items() if word in last]
    return ", ".join((*effects, *missed)) + f" will not be {under_way[0].goal}" if missed else ""


def bring_all(system: str, names: Sequence[str], goal: str, timeout: float = 0.0, say: Say = silent) -> None:
    """The same (default: all); Problem names the failed ones with reasons. `timeout` (s): for each step, 0: usual."""
    problems = bring(system, powered_names(system, names), goal, timeout, say)
    reported = [f"{name}: {problem}" for name, problem in problems.items() if problem]
    if reported:
        raise Problem("; ".join(reported))
