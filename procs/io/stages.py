"""The stages of a cycle that work on all axes at once: native code, or else numpy with bit-identical results.

`core` has the arrays, under the names of procs/native/io_fields.py. Rare cases are returned as a nonzero number; the
methods named there handle them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import IO, TRACK
from trocar.procs.native.library import bind
from trocar.procs.native.progress import CHECKED, CONTROLLED, DECODED, ENCODED, READY

if TYPE_CHECKING:
    from trocar.procs.io.cycle import RobotIo
    from trocar.procs.io.kinematic import KinematicIo


@dataclass(frozen=True, slots=True)
class Stages:
    """One call each a cycle, in this order."""

    track: Callable[[int], int]
    """Take the present setpoints. Bits of robots that `SetpointTracker.receive` must examine; see `everything` there.
    """
    decode: Callable[[], int]
    """Blocks to SI units and velocities. 1: status words or amplifiers have changed (`Power.step`)."""
    check: Callable[[], int]
    """Compare the sample with the limits. 1: a value is beyond its limit (`Safety.examine`)."""
    control: Callable[[], int]
    """The joint controllers. 1: a tracking error is too large (`Pid.beyond`)."""
    encode: Callable[[float, int], int]
    """Encode a share of the efforts; 1: with the words that act once. 0: an effort was not finite."""
    show: Callable[[], int]
    """Fill the rest of the record, after the boards are written. 1: an input has changed (`Buttons.settle`)."""
    at_once: Callable[[float], int]
    """From `decode` to `encode` with this share, up to the first stage with news, which is returned; else READY."""
    bound: BoundStruct | None = None
    """The arrays of the native library; None: numpy is used."""
    why_numpy: str = ""
    """Why the native library is not used; empty: it is."""


def stages(core: RobotIo) -> Stages:
    """The fastest available implementation."""
    bound = bind(IO, core)
    return numpy_stages(core, bound) if isinstance(bound, str) else native_stages(bound, tracking(core), core)


def tracking(core: RobotIo | KinematicIo) -> BoundStruct | str:
    """The data the native library needs to take setpoints; or the reason why it cannot."""
    return bind(TRACK, core) if core.follow.rings is not None else "setpoints come from no ring"


def track(core: RobotIo | KinematicIo) -> Callable[[int], int]:
    """The implementation of `Stages.track`."""
    tracked = tracking(core)
    return numpy_track(core) if isinstance(tracked, str) else tracked.function("track")


def native_stages(bound: BoundStruct, tracked: BoundStruct | str, core: RobotIo) -> Stages:
    """Native stages; numpy for setpoints where `tracked` is a reason."""
    decode, check, control, encode, show, at_once = map(bound.function, IO.functions)
    if isinstance(tracked, str):
        return Stages(numpy_track(core), decode, check, control, encode, show, at_once, bound, tracked)
    return Stages(tracked.function("track"), decode, check, control, encode, show, at_once, bound)


def numpy_track(core: RobotIo | KinematicIo) -> Callable[[int], int]:
    """numpy: `SetpointTracker.receive` examines all arms."""
    follow = core.follow
    return lambda now_ns: follow.everything


def numpy_stages(core: RobotIo, why: str) -> Stages:
    """numpy stages; `why` native code is not used."""
    samples, pid, check, encode = core.samples, core.pid, core.safety.check, core.outputs.encode

    def decode() -> int:
        samples.decode()
        return core.power.watch()

    def control() -> int:
        return pid.control(samples.position, samples.velocity)

    def show() -> int:
        samples.show()
        core.digital_outputs.show()
        return core.buttons.watch()

    def at_once(share: float) -> int:
        if decode():
            return DECODED
        if check():
            return CHECKED
        if control():
            return CONTROLLED
        return READY if encode(share, 0) else ENCODED

    return Stages(numpy_track(core), decode, check, control, encode, show, at_once, why_numpy=why)
