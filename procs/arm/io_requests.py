"""An arm's requests to io: desired states, sent with every setpoint until io's record shows them; and orders.

A desired state is a level: it needs no repetition, and none is lost when an io process dies. A request with an outcome
(the encoder bias, an encoder that is set, a memory that is read) is an order and goes through io's mailbox.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from numpy.typing import NDArray

from trocar.procs.arm.readings import ArmReadings
from trocar.procs.node.inputs import Fields
from trocar.procs.tables.desired_state import DESIRED_STATES, NONE, OFF, ON
from trocar.procs.tables.generation import WRAP, next_generation
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.messages import Reply
from trocar.shm.mailbox.origins import Origin

REFUSED_NS = 1_000_000_000
MEMORY = 64


class Switch:
    """One function of io that the arm wants on, off, or unchanged."""

    __slots__ = ("_flag", "_is_new", "wanted")

    def __init__(self, flag: NDArray[Any] | None, is_new: Callable[[], None]) -> None:
        """`flag` of io's record shows its state; None: the robot lacks the function, every desired state counts as
        reached.

        `is_new` is called at each change.
        """
        self._flag, self._is_new = flag, is_new
        self.wanted: bool | None = None

    def want(self, on: bool | None) -> None:
        """Change the desired state."""
        if on is not self.wanted:
            self.wanted = on
            self._is_new()

    @property
    def settled(self) -> bool:
        """Whether io's record shows the desired state."""
        return self.wanted is None or self._flag is None or bool(self._flag.item()) is self.wanted

    @property
    def code(self) -> int:
        """Its code in the setpoints."""
        return NONE if self.wanted is None or self._flag is None else ON if self.wanted else OFF


class IoRequests:
    """All switches of one robot, and the encoder bias, which is an order and not a level."""

    def __init__(self, io: ArmReadings, setpoint: Fields, sender: LoopClient, robot: str,
                 warn: Callable[[str], None], *, has_brakes: bool) -> None:
        """`setpoint` gives the fields for desired states; `warn` receives each refusal once."""
        self._io, self._sender, self._robot, self._warn = io, sender, robot, warn
        switches = {desired.name: Switch(getattr(io, desired.shown) if has_brakes or desired.name != "brakes" else None,
                                      self._change) for desired in DESIRED_STATES}
        self.power, self.pid, self.brakes = switches["power"], switches["pid"], switches["brakes"]
        self.limits, self.tracking = switches["limits"], switches["tracking"]
        self.velocity, self.pots = switches["velocity"], switches["pots"]
        self.no_fault = switches["fault"]
        self._out = [(switches[desired.name], setpoint(desired.field)) for desired in DESIRED_STATES]
        self._generation_out = setpoint("desired_generation")
        self._whose = setpoint("desired_origin"), setpoint("desired_since"), setpoint("desired_program")
        for cell in (*(cell for _, cell in self._out), self._generation_out, *self._whose):
            cell[...] = b"" if cell.dtype.kind == "S" else 0
        self._generation = 0
        self._refusal = ""
        self._is_new = False
        self._ended: dict[int, Reply] = {}
        self._samples = 0.0
        self._left_out: tuple[float, ...] = ()
        self._bias_next_ns = self._bias_id = 0
        self._bias_before = 0
        self.bias_refusal = ""

    def on_behalf(self, origin: Origin) -> None:
        """Attribute further requests to this operator's command; all desired states are sent as a new generation."""
        self._sender.on_behalf(origin)
        for cell, value in zip(self._whose, (origin.id, origin.generation, origin.program.encode()), strict=True):
            cell[...] = value
        self._change()

    def _change(self) -> None:
        self._is_new = True

    def order(self, name: str, values: Sequence[float], about: str = "") -> int:
        """Send an order about the robot or something else; returns its id, 0: no room for it.

        See `outcome`.
        """
        return self._sender.send(name, values, about or self._robot)

    def outcome(self, number: int) -> Reply | None:
        """The reply to an `order`; None: not yet."""
        return self._ended.pop(number, None)

    def want_no_fault(self, desired: bool) -> None:
        """Have io clear its latched fault (the switch is 'fault present', wanted off)."""
        self.no_fault.want(False if desired else None)

    def bias(self, samples: float, left_out: Sequence[int] = ()) -> None:
        """Have the encoders set from this many potentiometer samples; negative: preset encoders are accepted.

        `left_out`: actuators whose potentiometers do not measure the position.
        """
        self._samples = samples
        self._left_out = tuple(map(float, left_out))
        self._bias_next_ns = self._bias_id = 0
        self._bias_before = int(self._io.bias_generation.item())
        self.bias_refusal = ""

    def forget_bias(self) -> None:
        """Stop waiting for a bias."""
        self._samples = 0.0

    @property
    def is_void(self) -> bool:
        """Whether io has read the desired states and a later fault or operator's command to io has voided them."""
        io = self._io
        return bool(io.desired_void.item()) and int(io.desired_generation.item()) == self._generation

    @property
    def refusals(self) -> str:
        """io's refusals of desired states that are not reached, and of the bias."""
        return "; ".join(filter(None, (self._refused(), self.bias_refusal)))

    def _refused(self) -> str:
        io = self._io
        if int(io.desired_generation.item()) != self._generation:
            return ""
        return bytes(io.desired_refused.item()).decode(errors="replace")

    @property
    def bias_done(self) -> bool:
        """Whether io's record shows the requested bias."""
        io = self._io
        counted = int(io.bias_generation.item()) != self._bias_before
        return bool(self._samples and counted and io.biased.item() and not io.biasing.item())

    def step(self, now_ns: int) -> None:
        """Put the desired states into the setpoints, and send pending orders, unless io does not answer."""
        for answer in self._sender.poll():
            self._heard(answer)
        if self._is_new:
            self._publish()
        if not self._io.fresh:
            return
        if self._io.desired_refused.item() and not self.is_void:
            self._hear_refusal()
        if self._samples and now_ns >= self._bias_next_ns and not self._io.biasing.item() and not self.bias_done:
            # repeated only after a second: between acceptance and the first sample io's record shows nothing
            self._bias_next_ns = now_ns + REFUSED_NS
            self._bias_id = self._sender.send("bias_encoders", (self._samples, *self._left_out), self._robot)

    def _publish(self) -> None:
        """Publish another generation, different from those of the previous process."""
        self._is_new = False
        seen = int(self._io.desired_generation.item())
        is_ahead = (seen - self._generation) % WRAP < WRAP // 2
        self._generation = next_generation(seen if is_ahead else self._generation)
        self._generation_out[...] = self._generation
        for switch, cell in self._out:
            cell[...] = switch.code

    def _hear_refusal(self) -> None:
        refusal = self._refused()
        if refusal and refusal != self._refusal:
            self._refusal = refusal
            self._warn(f"io refused a request: {refusal}")

    def _heard(self, answer: Reply) -> None:
        if answer.outcome == "accepted":
            return
        if answer.id != self._bias_id:
            if len(self._ended) >= MEMORY:
                self._ended.clear()
            self._ended[answer.id] = answer
        elif answer.outcome != "done":
            if answer.text != self.bias_refusal:
                self._warn(f"io refuses to bias the encoders: {answer.text}")
            self.bias_refusal = answer.text
