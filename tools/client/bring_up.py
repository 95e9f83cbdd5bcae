"""Arms brought to a state through their `state_command`, several at a time: enabled, homed or disabled.

Arms in FAULT are disabled first. Success is checked in the arms' own state records, power-off in io's.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from trocar.procs.tables import bring_up as rule
from trocar.shm.commands import became
from trocar.shm.mailbox.client import begin
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.deadline import Deadline
from trocar.tools.client.remote import NO_ANSWER, Remote
from trocar.tools.inspect.watch import Amplifiers, Watch, powered_names
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say
from trocar.tools.systems.find import is_simulated, orphaned

POLL_S = 0.02
ANSWER_S = 2.0
CONTINUES = {rule.HOME: "arms may move", rule.ENABLE: "arms may still get power",
             rule.DISABLE: "arms may still lose power"}
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
    asked: str = ""
    _number: int = 0
    _outcome: str = ""
    """Of the word `asked` last."""
    _refusal: str = ""
    """Why it was refused or failed."""
    _deadline: Deadline | None = None
    _waits: str = ""
    _reported: str = ""
    _since_ns: int = 0

    def step(self) -> None:
        """Look, and send the next command once; its answer is awaited in later steps."""
        watch, aim, refusal = self.watch, (rule.WORDS[self.goal], self.asked), self._refusal
        self._hear()
        state = watch.state if watch.look() else ""
        is_heard = not self.asked or (self._outcome and not self._refusal)
        if is_heard and rule.reached(*aim, self._outcome == "done", state, watch.homed, watch.busy):
            problem = watch.problem()  # the record of a crashed or hanging process stays unchanged
            problem = problem or (self.amplifiers.why_not_off() if self.goal == rule.DISABLED else "")
            self.over = not problem
            if problem:
                self._check_time(f"not {self.goal} in time; {problem}")
        elif problem := rule.obstacle(*aim, state, watch.name, watch.text("reason")):
            self._fail((state == "FAULT" and watch.last_error()) or problem)
        elif refusal:  # of the step before: a fault shows in the record by now
            self._fail(refusal)
        elif (word := rule.next_word(*aim, state)) and not self.remote.is_starting:
            self._ask(word)
        else:
            self._check_time(rule.late(aim[0], state, watch.text("sub_state"), watch.text("reason"), watch.problem()))

    def _ask(self, word: str) -> None:
        self.asked, self._outcome, self._refusal, self._deadline = word, "", "", self._limit(ANSWER_S)
        self.watch.forget_errors()
        try:
            self._number = self.remote.post("state_command", text=word)
        except Problem as problem:
            self._fail(str(problem))

    def _hear(self) -> None:
        for reply in self.remote.replies_to(self._number):
            self._deadline = self._deadline if self._outcome else self._limit()
            self._outcome = reply.outcome
            if reply.outcome in ("refused", "failed"):
                self._refusal = f"{self.asked} {became(reply.outcome)}: {reply.text}"

    def _limit(self, seconds: float = 0.0) -> Deadline:
        return Deadline(seconds or self.limit_s or rule.LIMITS_S[self.asked],
                        (lambda: self.watch.stamp_ns) if self.simulated else None)

    def _check_time(self, how: str) -> None:
        self._deadline = self._deadline or self._limit()
        if self.watch.problem() and (lost := orphaned(self.watch.system)):
            self._fail(lost)
        elif self._deadline.is_over():
            error = self.watch.last_error()
            known = f": {error}" if error and not self.waits else ""
            is_silent = self.asked and not self._outcome
            self._fail(NO_ANSWER.format("state_command", ANSWER_S) if is_silent else how + known)

    def _fail(self, why: str) -> None:
        self.over, self.problem = True, why.removeprefix(f"{self.watch.name}: ")

    @property
    def waits(self) -> str:
        """The condition the arm waits for, in its own words; empty: none."""
        return rule.waits_for(self.watch.state, self.watch.text("reason"))

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
        attach = stack.enter_context
        bring_ups = [ArmBringUp(attach(Watch(system, name)), attach(Remote(system, name)),
                                attach(Amplifiers(system, name)), goal, limit_s, simulated) for name in names]
        for bring_up in bring_ups:
            bring_up.remote.on_behalf(whole)
        try:
            while under_way := [bring_up for bring_up in bring_ups if not bring_up.over]:
                for bring_up in under_way:
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
    last = {bring_up.asked for bring_up in under_way}
    missed = [bring_up.watch.name for bring_up in under_way if rule.WORDS[bring_up.goal] != bring_up.asked]
    effects = [text for word, text in CONTINUES.items() if word in last]
    return ", ".join((*effects, *missed)) + f" will not be {under_way[0].goal}" if missed else ""


def bring_all(system: str, names: Sequence[str], goal: str, timeout: float = 0.0, say: Say = silent) -> None:
    """The same (default: all); Problem names the failed ones with reasons. `timeout` (s): for each step, 0: usual."""
    problems = bring(system, powered_names(system, names), goal, timeout, say)
    reported = [f"{name}: {problem}" for name, problem in problems.items() if problem]
    if reported:
        raise Problem("; ".join(reported))
