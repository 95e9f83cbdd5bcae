"""The stages of a cycle that work on all axes at once: by native code, else by numpy, which gives the same to the bit.

`core` has the arrays, under the names of procs/native/io_fields.py. What is rare comes back as a number, not 0, and is
handled by who is named there.
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


def stages(core: RobotIo) -> Stages:
    """The quickest there are."""
    bound = bind(IO, core)
    return numpy_stages(core, bound) if isinstance(bound, str) else native_stages(bound, tracking(core), core)


def tracking(core: RobotIo | KinematicIo) -> BoundStruct | str:
    """What the native library needs to take setpoints; why it does not, in words."""
    return bind(TRACK, core) if core.follow.rings is not None else "setpoints come from no ring"


def track(core: RobotIo | KinematicIo) -> Callable[[int], int]:
    """See Stages."""
    tracked = tracking(core)
    return numpy_track(core) if isinstance(tracked, str) else tracked.function("track")


def native_stages(bound: BoundStruct, tracked: BoundStruct | str, core: RobotIo) -> Stages:
    """By native code, but for setpoints where `tracked` says why not."""
    decode, check, control, encode, show, at_once = map(bound.function, IO.functions)
    if isinstance(tracked, str):
        return Stages(numpy_track(core), decode, check, control, encode, show, at_once, bound, tracked)
    return Stages(tracked.function("track"), decode, check, control, encode, show, at_once, bound)


def numpy_track(core: RobotIo | KinematicIo) -> Callable[[int], int]:
    """By numpy: `SetpointTracker.receive` looks at everybody."""
    follow = core.follow
    return lambda now_ns: follow.everything


def numpy_stages(core: RobotIo, why: str) -> Stages:
    """By numpy; `why` not by native code."""
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
