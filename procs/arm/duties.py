"""What the arm wants of io, by level: asked for until io's record shows it, and never in a flood.

A command may be lost with an io process that dies, so nothing is taken for done before the record says so. Each
switch is asked for at once when it is wanted, then again every `RETRY_NS`, and slower when io refuses it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from numpy.typing import NDArray

from procs.arm.readings import Readings
from procs.lib.requests import Answer, Origin, Sender

RETRY_NS = 100_000_000
REFUSED_NS = 1_000_000_000
MEMORY = 64

Order = tuple[str, tuple[float, ...]]  # a command of io and its numbers


class Wishes:
    """Whether any wish is new or not yet fulfilled."""

    def __init__(self) -> None:
        self.changed = True


class Switch:
    """One thing of io that the arm wants on, off, or has no wish about."""

    __slots__ = ("_flag", "_next_ns", "_off", "_on", "_wishes", "refusal", "wanted")

    def __init__(self, wishes: Wishes, flag: NDArray[Any] | None, on: Order, off: Order) -> None:
        """`flag` of io's record shows it; None: the robot has no such thing, every wish is fulfilled."""
        self._wishes = wishes
        self._flag, self._on, self._off = flag, on, off
        self.wanted: bool | None = None
        self.refusal = ""
        self._next_ns = 0

    def want(self, on: bool | None) -> None:
        """Change the wish; a new one is sent at once."""
        if on is not self.wanted:
            self.wanted = on
            self.refusal = ""
            self._next_ns = 0
            self._wishes.changed = True

    def again(self) -> None:
        """What was refused is to be asked for without a pause."""
        if self.refusal:
            self._next_ns = 0

    @property
    def settled(self) -> bool:
        """io's record shows what is wanted."""
        return self.wanted is None or self._flag is None or bool(self._flag.item()) is self.wanted

    def due(self, now_ns: int) -> Order | None:
        """The command to send now, if any."""
        if self.wanted is None or self.settled or now_ns < self._next_ns:
            return None
        self._next_ns = now_ns + RETRY_NS
        return self._on if self.wanted else self._off

    def sent(self, now_ns: int) -> None:
        """It was asked for in another way."""
        self._next_ns = now_ns + RETRY_NS

    def refused(self, now_ns: int, reason: str) -> bool:
        """io said no; True when this is news."""
        news = reason != self.refusal
        self.refusal = reason
        self._next_ns = now_ns + REFUSED_NS
        return news


class Duties:
    """All switches of one robot, and the encoder bias, which is an order and not a level."""

    def __init__(self, io: Readings, sender: Sender, robot: str, warn: Callable[[str], None], *,
                 has_brakes: bool) -> None:
        """`warn` hears of refusals, once each."""
        self._io, self._sender, self._robot, self._warn = io, sender, robot, warn
        self._wishes = wishes = Wishes()
        self._turn = 0
        self.power = Switch(wishes, io.power_wanted, ("power_on", ()), ("power_off", (0.0,)))
        self.pid = _switch(wishes, io.pid_enabled, "pid_enable")
        self.limits = _switch(wishes, io.limits_enforced, "enforce_limits")
        self.tracking = _switch(wishes, io.tracking_check, "tracking_check")
        self.velocity = _switch(wishes, io.velocity_used, "use_setpoint_v")
        self.pots = _switch(wishes, io.pot_check, "pot_check")
        self.no_fault = Switch(wishes, io.fault, ("clear_fault", ()), ("clear_fault", ()))
        brakes = io.brakes_released if has_brakes else None
        self.brakes = Switch(wishes, brakes, ("brake_release", ()), ("brake_engage", ()))
        self._switches = (self.brakes, self.pid, self.power, self.limits, self.tracking, self.velocity, self.pots,
                          self.no_fault)
        self._asked: dict[int, Switch] = {}
        self._ended: dict[int, Answer] = {}
        self._samples = 0.0
        self._left_out: tuple[float, ...] = ()
        self._bias_next_ns = self._bias_id = 0
        self._bias_before = 0
        self._again = False
        self.bias_refusal = ""

    def on_behalf(self, origin: Origin) -> None:
        """What io is asked for from now on comes from this command of a person; what it refused is asked at once."""
        self._sender.on_behalf(origin)
        for switch in self._switches:
            switch.again()
        self._wishes.changed = True

    def order(self, name: str, values: Sequence[float], about: str = "") -> int:
        """Send a command that is no level, about the robot or something else; returns its id, 0: no room for it.

        See `outcome`.
        """
        return self._sender.send(name, values, about or self._robot)

    def outcome(self, number: int) -> Answer | None:
        """How an `order` ended; None: not yet."""
        return self._ended.pop(number, None)

    def want_no_fault(self, wish: bool) -> None:
        """Have io forget its latched fault (the switch is 'fault present', wanted off)."""
        self.no_fault.want(False if wish else None)

    def power_again(self, now_ns: int) -> None:
        """Ask for power once more, whatever io shows to be wanted: the first try has failed."""
        self._again = True
        self.power.sent(now_ns)  # not as a switch: that would be before the fault is cleared

    def bias(self, samples: float, left_out: Sequence[int] = ()) -> None:
        """Have the encoders set from this many potentiometer samples; negative: a preset encoder will do.

        `left_out`: actuators whose potentiometers do not tell where they are.
        """
        self._samples = samples
        self._left_out = tuple(map(float, left_out))
        self._bias_next_ns = self._bias_id = 0
        self._bias_before = int(self._io.bias_generation.item())
        self.bias_refusal = ""

    def forget_bias(self) -> None:
        """Nobody waits for a bias any more."""
        self._samples = 0.0

    @property
    def refusals(self) -> str:
        """What io said to the requests that failed."""
        switches = (self.power, self.pid, self.brakes, self.limits, self.no_fault)
        return "; ".join(filter(None, (*(switch.refusal for switch in switches), self.bias_refusal)))

    @property
    def bias_done(self) -> bool:
        """The bias that was asked for shows in io's record."""
        io = self._io
        counted = int(io.bias_generation.item()) != self._bias_before
        return bool(self._samples and counted and io.biased.item() and not io.biasing.item())

    def step(self, now_ns: int) -> None:
        """Send what is due; nothing goes to an io that does not answer."""
        for answer in self._sender.poll():
            self._heard(now_ns, answer)
        if not self._io.fresh:
            return
        if self._wishes.changed:
            for switch in self._switches:
                self._see_to(switch, now_ns)
            self._wishes.changed = not all(switch.settled for switch in self._switches)
        else:  # all is as wanted: one look a cycle is enough to notice that it no longer is
            self._turn = (self._turn + 1) % len(self._switches)
            switch = self._switches[self._turn]
            if not switch.settled:
                self._wishes.changed = True
                self._see_to(switch, now_ns)
        if self._again:
            self._again = False
            self._sender.send("power_off", (0.0,), self._robot)  # power_on alone means nothing to an io that tries
            self._sender.send("power_on", (), self._robot)
        if self._samples and now_ns >= self._bias_next_ns and not self._io.biasing.item() and not self.bias_done:
            # asked again only after a second: between acceptance and the first sample io's record shows nothing
            self._bias_next_ns = now_ns + REFUSED_NS
            self._bias_id = self._sender.send("bias_encoders", (self._samples, *self._left_out), self._robot)

    def _see_to(self, switch: Switch, now_ns: int) -> None:
        command = switch.due(now_ns)
        if command is not None:
            number = self._sender.send(command[0], command[1], self._robot)
            if number:
                self._remember(number, switch)

    def _remember(self, number: int, switch: Switch) -> None:
        if len(self._asked) >= MEMORY:  # replies that never came: their io has died
            self._asked.clear()
        self._asked[number] = switch

    def _heard(self, now_ns: int, answer: Answer) -> None:
        if answer.outcome == "accepted":
            return
        switch = self._asked.pop(answer.id, None)
        if switch is None and answer.id != self._bias_id:
            if len(self._ended) >= MEMORY:
                self._ended.clear()
            self._ended[answer.id] = answer
        if answer.outcome == "done":
            return
        if answer.id == self._bias_id:
            if answer.text != self.bias_refusal:
                self._warn(f"io will not bias the encoders: {answer.text}")
            self.bias_refusal = answer.text
        elif switch is not None and switch.refused(now_ns, answer.text):
            self._warn(f"io refused a request: {answer.text}")


def _switch(wishes: Wishes, flag: NDArray[Any], command: str) -> Switch:
    return Switch(wishes, flag, (command, (1.0,)), (command, (0.0,)))
