"""The stages of a cycle that work on all axes at once: by native code, else by numpy, which gives the same to the bit.

What is rare comes back as a number, not 0, and is handled by who is named there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from trocar.procs.io.arm_requests import ArmRequests
from trocar.procs.io.buttons import Buttons
from trocar.procs.io.digital_outputs import DigitalOutputs
from trocar.procs.io.outputs import Outputs
from trocar.procs.io.pid import Pid
from trocar.procs.io.power import Power
from trocar.procs.io.record import IoRecord
from trocar.procs.io.robots import Robots, Samples
from trocar.procs.io.safety import Safety
from trocar.procs.io.setpoint_tracker import SetpointTracker
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import IO
from trocar.procs.native.library import bind
from trocar.procs.native.progress import CHECKED, CONTROLLED, DECODED, ENCODED, READY
from trocar.procs.native.track_fields import TRACK


class Tracks(Protocol):
    """Who takes setpoints; the native library finds the arrays by these names (procs/native/track_fields.py)."""

    robots: Robots
    record: IoRecord
    follow: SetpointTracker
    desired: ArmRequests
    pid: Pid


class Parts(Tracks, Protocol):
    """Whose arrays the stages work on; the native library finds them by these names (procs/native/io_fields.py)."""

    samples: Samples
    power: Power
    safety: Safety
    outputs: Outputs
    digital_outputs: DigitalOutputs
    buttons: Buttons


@dataclass(frozen=True, slots=True)
class Stages:
    """One call each a cycle, in this order."""

    track: Callable[[int], int]
    """Setpoints of now. Bits of robots that `SetpointTracker.receive` has to look at; see `everything` there."""
    decode: Callable[[], int]
    """Blocks to SI units and velocities. 1: status words or amplifiers have changed (`Power.step`)."""
    check: Callable[[], int]
    """The sample against its limits. 1: something is beyond them (`Safety.examine`)."""
    control: Callable[[], int]
    """The joint controllers. 1: a tracking error is too large (`Pid.beyond`)."""
    encode: Callable[[float, int], int]
    """A share of the efforts to words; 1: with what acts once. 0: an effort was not finite."""
    show: Callable[[], int]
    """The rest of the record, once the boards are written. 1: an input has changed (`Buttons.settle`)."""
    at_once: Callable[[float], int]
    """From `decode` to `encode` with this share, up to the first that has news: which that is; else READY."""
    bound: BoundStruct | None = None
    """What the native library works on; None: numpy does the work."""
    why_numpy: str = ""
    """Why the native library does not do it; empty: it does."""


def stages(parts: Parts) -> Stages:
    """The quickest there are."""
    bound = bind(IO, parts)
    return numpy_stages(parts, bound) if isinstance(bound, str) else native_stages(bound, tracking(parts), parts)


def tracking(parts: Tracks) -> BoundStruct | str:
    """What the native library needs to take setpoints; why it does not, in words."""
    return bind(TRACK, parts) if parts.follow.rings is not None else "setpoints come from no ring"


def track(parts: Tracks) -> Callable[[int], int]:
    """See Stages."""
    tracked = tracking(parts)
    return numpy_track(parts) if isinstance(tracked, str) else tracked.function("track")


def native_stages(bound: BoundStruct, tracked: BoundStruct | str, parts: Parts) -> Stages:
    """By native code, but for setpoints where `tracked` says why not."""
    decode, check, control, encode, show, at_once = map(bound.function, IO.functions)
    if isinstance(tracked, str):
        return Stages(numpy_track(parts), decode, check, control, encode, show, at_once, bound, tracked)
    return Stages(tracked.function("track"), decode, check, control, encode, show, at_once, bound)


def numpy_track(parts: Tracks) -> Callable[[int], int]:
    """By numpy: `SetpointTracker.receive` looks at everybody."""
    follow = parts.follow
    return lambda now_ns: follow.everything


def numpy_stages(parts: Parts, why: str) -> Stages:
    """By numpy; `why` not by native code."""
    samples, pid, check, encode = parts.samples, parts.pid, parts.safety.check, parts.outputs.encode

    def decode() -> int:
        samples.decode()
        return parts.power.watch()

    def control() -> int:
        return pid.control(samples.position, samples.velocity)

    def show() -> int:
        samples.show()
        parts.digital_outputs.show()
        return parts.buttons.watch()

    def at_once(share: float) -> int:
        if decode():
            return DECODED
        if check():
            return CHECKED
        if control():
            return CONTROLLED
        return READY if encode(share, 0) else ENCODED

    return Stages(numpy_track(parts), decode, check, control, encode, show, at_once, why_numpy=why)
