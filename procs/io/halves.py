"""The two halves of a cycle that work on all axes at once, and what the rest of the record shows.

    receive_and_check   reply → SI units, velocities, limits, tracking errors
    control_and_send    setpoints → joint controllers → words → write

Between them Python acts, if the first half returned a bit. The methods here are numpy. The native library replaces
`decode_and_check`, `control_and_encode` and `show` by functions with bit-identical results; on a bus with one query and
one write for all boards, they are then part of the native calls that receive and send, or of one call that does both.
"""

from __future__ import annotations

from collections.abc import Callable

from trocar.procs.io.assemble import IoContext, Parts
from trocar.procs.io.bus.exchange import Exchange, ExchangeSettings
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import CONTROLLED, IO, LIMIT, MISSED, NOT_FINITE, SENT, STATUS, TRACK, TRACKING
from trocar.procs.native.library import bind


class Halves:
    """Both halves for one io."""

    def __init__(self, parts: Parts, context: IoContext, uses: tuple[int, float, float], *, native: bool = True
                 ) -> None:
        """`parts` have the arrays, under the names of procs/native/io_fields.py. `uses`: see ExchangeSettings.
        `native`: use the native library if there is one.
        """
        self._port, self._outputs, self._samples, self._pid = parts.port, parts.outputs, parts.samples, parts.pid
        self._power, self._safety = parts.power, parts.safety
        self._digital_outputs, self._buttons = parts.digital_outputs, parts.buttons
        self._is_over, self._over_ns = context.is_over, context.over_ns
        self.bound = bind(IO, parts) if native else "numpy is wanted"
        """The arrays of the native library; or why it is not used."""
        self.track, self.why_numpy = track(parts)
        """Takes setpoints; and why numpy computes some part, empty: none."""
        if isinstance(self.bound, BoundStruct):
            self.decode_and_check, self.control_and_encode, self.show = (  # type: ignore[method-assign]
                self.bound.function(name) for name in IO.functions)
            parts.port.set_exchange(ExchangeSettings(self.bound, *uses))
        else:
            self.track, self.why_numpy = numpy_track(parts), self.bound

    def receive_and_check(self, good_ns: int, wake_ns: int, gap_ns: float) -> int:
        """Receive the sample that `BusPort.ask_all` asked for, and check it. 0, or bits:

        MISSED: there is no complete fresh sample. STATUS: status words or amplifiers have changed (`Power.step`).
        LIMIT: a value is beyond its limit (`Safety.examine`). TRACKING: so is a tracking error (`Pid.beyond`).

        Without a bit, for samples before `wake_ns`, the native calls may do the other half as well, and then return its
        bits. `good_ns`: when the previous sample arrived; `gap_ns`: mean interval of the samples so far.
        """
        port, exchange = self._port, self._port.exchange
        if exchange is None:
            return self.decode_and_check() if port.read_all() else MISSED
        bits = exchange.receive_and_check(good_ns, wake_ns, self._over_ns(), gap_ns)
        port.recv_ns = exchange.link.recv_ns
        port.counters.reads += 1
        if bits & MISSED:
            port.counters.bad_reads += 1
        return self._noted(bits, exchange)

    def control_and_send(self, share: float, has_sample: bool) -> int:
        """Send this share of the joint controllers' efforts; without a sample that of their last ones.

        Bits: NOT_FINITE: 0 A was sent for an effort that is not finite. After a stall all outputs are off instead.
        """
        port, outputs = self._port, self._outputs
        if port.exchange is not None:
            bits = self._noted(port.exchange.control_and_send(share, has_sample, self._over_ns()), port.exchange)
        else:
            bits = self.control_and_encode(share, has_sample)
        if not bits & SENT:
            if self._is_over():  # the efforts are outdated, and so are switch-on commands
                outputs.all_off()
                self.control_and_encode(0.0, False)
            if not port.write_all():
                return bits  # what acts once is sent with the next write
        outputs.written()
        return bits

    def _noted(self, bits: int, exchange: Exchange) -> int:
        if bits & SENT:
            self._port.send_ns = exchange.link.send_ns
            self._port.counters.writes += 1
        return bits

    def decode_and_check(self) -> int:
        """The bits of `receive_and_check` for the sample in the port's blocks."""
        samples, bits = self._samples, 0
        samples.decode()
        if self._power.watch():
            bits |= STATUS
        if self._safety.check():
            bits |= LIMIT
        if self._pid.compare(samples.position):
            bits |= TRACKING
        return bits

    def control_and_encode(self, share: float, has_sample: int) -> int:
        """`control_and_send` without the sending: into the port's `out`."""
        controlled = not has_sample or self._pid.control(self._samples.position, self._samples.velocity)
        encoded = self._outputs.encode(share)
        return (0 if controlled and encoded else NOT_FINITE) | (CONTROLLED if has_sample else 0)

    def show(self) -> int:
        """Fill the rest of the record, after the boards are written. 1: an input has changed (`Buttons.settle`)."""
        self._samples.show()
        self._digital_outputs.show()
        return self._buttons.watch()


def track(parts: Parts) -> tuple[Callable[[int], int], str]:
    """The function that takes the present setpoints, and why it is numpy's, if it is.

    It returns bits of robots that `SetpointTracker.receive` must examine; see `everything` there.
    """
    if parts.follow.rings is None:
        return numpy_track(parts), "setpoints come from no ring"
    bound = bind(TRACK, parts)
    return (numpy_track(parts), bound) if isinstance(bound, str) else (bound.function("track"), "")


def numpy_track(parts: Parts) -> Callable[[int], int]:
    """numpy: `SetpointTracker.receive` examines all arms."""
    return lambda now_ns: parts.follow.everything
