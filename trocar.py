"""Trocar for scripts: arms and systems by name, with CRTK's words.

    import trocar

    with trocar.arm("PSM1") as psm:
        psm.home(60)
        psm.move_jp([0, 0, 0.12, 0, 0, 0]).wait()
        position, stamp_ns = psm.measured_jp()

Each read returns (value, stamp): the stamp is monotonic nanoseconds. Joints are rad and m, poses 4×4 matrices. Waits
have time-outs in seconds. What the robot refuses raises `Refused` with its reason; what cannot be had, `TimeoutError`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from procs.lib.poses import matrix_from_pose
from shm.clock import monotonic_ns, pause
from shm.segment import SegmentError
from tools import arms as _arms
from tools.errors import Problem, Refused
from tools.processes import Life, lives
from tools.remote import Remote
from tools.systems import chosen_system
from tools.views import Source, open_topic
from tools.watch import Watch, arm_names

Array = NDArray[np.float64]
Stamped = tuple[Array, int]

FRESH_S = 1.0  # a getter raises when the newest value is older
POLL_S = 0.002
JAW_OPEN, JAW_CLOSED = math.radians(60.0), math.radians(-20.0)
TRY_AGAIN_S = 0.05

T = TypeVar("T")

__all__ = ["Arm", "Jaw", "JointState", "MoveHandle", "Problem", "Refused", "System", "arm", "system"]


class JointState(NamedTuple):
    """Joint positions, velocities and efforts (n,); empty where a topic has none."""

    position: Array
    velocity: Array
    effort: Array


class MoveHandle:
    """A move under way."""

    def __init__(self, remote: Remote, number: int, what: str) -> None:
        """`number` is the command's."""
        self._remote, self._number, self._what = remote, number, what
        self._outcome, self._reason = "", ""

    def is_busy(self) -> bool:
        """Whether it still moves; Refused when it ended before its goal."""
        for reply in self._remote.replies_to(self._number):
            if reply.outcome in ("done", "failed", "refused"):
                self._outcome, self._reason = reply.outcome, reply.text
        if self._outcome in ("failed", "refused"):
            raise Refused(f"{self._what} was {self._outcome}: {self._reason}")
        return not self._outcome

    def wait(self, timeout: float = 30.0) -> None:
        """Until the goal is reached; TimeoutError after `timeout` s, Refused when the move ended before."""
        _until(lambda: not self.is_busy(), timeout, f"{self._what} is not done")


class _Joints:
    """Reads of one set of joints: an arm's, or a jaw's."""

    def __init__(self, system: str, name: str, prefix: str) -> None:
        self._measured = open_topic(system, f"{name}/{prefix}measured_js")
        self._setpoint = open_topic(system, f"{name}/{prefix}setpoint_js")

    def measured_js(self) -> tuple[JointState, int]:
        """Measured positions, velocities and efforts."""
        return _joint_state(self._measured)

    def measured_jp(self) -> Stamped:
        """Measured positions."""
        return _part(self._measured, "position")

    def measured_jv(self) -> Stamped:
        """Measured velocities."""
        return _part(self._measured, "velocity")

    def measured_jf(self) -> Stamped:
        """Measured efforts."""
        return _part(self._measured, "effort")

    def setpoint_js(self) -> tuple[JointState, int]:
        """Positions, velocities and efforts the joint controller was last given."""
        return _joint_state(self._setpoint)

    def setpoint_jp(self) -> Stamped:
        """Set-point positions."""
        return _part(self._setpoint, "position")

    def setpoint_jv(self) -> Stamped:
        """Set-point velocities."""
        return _part(self._setpoint, "velocity")

    def setpoint_jf(self) -> Stamped:
        """Set-point efforts."""
        return _part(self._setpoint, "effort")

    def _close_views(self) -> None:
        self._measured.close()
        self._setpoint.close()


class Jaw(_Joints):
    """The jaw of an arm's instrument: angles in rad."""

    def __init__(self, system: str, name: str, remote: Remote) -> None:
        """Made by `Arm`."""
        super().__init__(system, name, "jaw/")
        self._remote = remote

    def servo_jp(self, position: float) -> None:
        """Follow this angle now."""
        self._remote.ask("jaw/servo_jp", (position,))

    def servo_jf(self, effort: float) -> None:
        """Apply this effort (N·m); the arm must be in effort mode."""
        self._remote.ask("jaw/servo_jf", (effort,))

    def move_jp(self, position: float) -> MoveHandle:
        """Move to this angle."""
        return MoveHandle(self._remote, self._remote.ask("jaw/move_jp", (position,)), "jaw/move_jp")

    def open(self, angle: float = JAW_OPEN) -> MoveHandle:
        """Open, to 60° unless told otherwise."""
        return self.move_jp(angle)

    def close(self, angle: float = JAW_CLOSED) -> MoveHandle:
        """Close, to −20° unless told otherwise: the instrument grips."""
        return self.move_jp(angle)


class Arm(_Joints):
    """One arm of a running system; a context manager. Made by `arm`."""

    def __init__(self, system: str, name: str) -> None:
        """Attach; Problem or SegmentError when the arm is not there (yet)."""
        arm_names(system, [name])
        super().__init__(system, name, "")
        self.name, self.system = name, system
        self._cp = {which: open_topic(system, f"{name}/{which}_cp") for which in ("measured", "setpoint")}
        self._local = {which: open_topic(system, f"{name}/local/{which}_cp") for which in ("measured", "setpoint")}
        self._jacobian = open_topic(system, f"{name}/body/jacobian")
        self._watch = Watch(system, name)
        self._remote = Remote(system, name)
        self.jaw = Jaw(system, name, self._remote)

    def connected(self) -> bool:
        """Whether the arm shows fresh records."""
        return self._watch.look() and self._watch.age_s < FRESH_S

    def measured_cp(self) -> Stamped:
        """Measured tip pose (4, 4) in the reference frame."""
        return _pose(self._cp["measured"])

    def setpoint_cp(self) -> Stamped:
        """Set-point tip pose (4, 4) in the reference frame."""
        return _pose(self._cp["setpoint"])

    def local_measured_cp(self) -> Stamped:
        """Measured tip pose (4, 4) in the arm's base."""
        return _pose(self._local["measured"])

    def local_setpoint_cp(self) -> Stamped:
        """Set-point tip pose (4, 4) in the arm's base."""
        return _pose(self._local["setpoint"])

    def jacobian(self) -> Stamped:
        """Body Jacobian (6, n) at the tip, linear rows first."""
        return _part(self._jacobian, "data")

    def operating_state(self) -> tuple[str, int]:
        """DISABLED, ENABLED, PAUSED or FAULT."""
        self._look()
        return self._watch.state, self._watch.reader.stamp_ns

    def is_homed(self) -> bool:
        """Homed, and powered."""
        self._look()
        return self._watch.homed

    def is_busy(self) -> bool:
        """A move or a transition is under way."""
        self._look()
        return self._watch.busy

    def state_command(self, word: str) -> None:
        """enable, disable, home, unhome, pause or resume; Refused when it is not allowed now."""
        self._remote.ask("state_command", text=word)

    def enable(self, timeout: float = 10.0) -> None:
        """Power on and wait until it is."""
        _arms.power_on(self.system, [self.name], timeout)

    def disable(self, timeout: float = 10.0) -> None:
        """Power off and wait until it is."""
        _arms.power_off(self.system, [self.name], timeout)

    def home(self, timeout: float = 60.0) -> None:
        """Enable where needed, home, and wait until it is homed."""
        _arms.home(self.system, [self.name], timeout)

    def unhome(self, timeout: float = 10.0) -> None:
        """Forget the homing and wait until it is forgotten."""
        self.state_command("unhome")
        _until(lambda: not self.is_homed(), timeout, f"{self.name} is still homed")

    def move_jp(self, position: ArrayLike) -> MoveHandle:
        """Move to joint positions (n,) and stop there."""
        return self._move("move_jp", position)

    def move_jr(self, increment: ArrayLike) -> MoveHandle:
        """Move by joint increments (n,)."""
        return self._move("move_jr", increment)

    def servo_jp(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Follow joint positions (n,) now, with their velocities (n,) where given."""
        values = _numbers(position)
        self._remote.ask("servo_jp", values if velocity is None else np.concatenate((values, _numbers(velocity))))

    def servo_jr(self, increment: ArrayLike) -> None:
        """Follow the set-point plus these increments (n,)."""
        self._remote.ask("servo_jr", _numbers(increment))

    def servo_jf(self, effort: ArrayLike) -> None:
        """Apply joint efforts (n,), N·m and N."""
        self._remote.ask("servo_jf", _numbers(effort))

    def hold(self) -> None:
        """Stay at the present set-point."""
        self._remote.ask("hold")

    def free(self) -> None:
        """Zero efforts; the arm can be moved by hand."""
        self._remote.ask("free")

    def trajectory_j_set_ratio(self, ratio: float) -> None:
        """Speed and acceleration of moves, above 0 up to 1."""
        self._remote.ask("trajectory_j/set_ratio", (ratio,))

    def trajectory_j_get_ratio(self) -> float:
        """The ratio in use; 0: speed and acceleration differ."""
        self._look()
        return float(self._watch.reader.field("trajectory_ratio"))

    def _move(self, command: str, values: ArrayLike) -> MoveHandle:
        return MoveHandle(self._remote, self._remote.ask(command, _numbers(values)), f"{self.name} {command}")

    def _look(self) -> None:
        if not self.connected():
            raise TimeoutError(f"{self.name} has not shown its state for {FRESH_S:g} s")

    def close(self) -> None:
        """Detach; the arm goes on with what it does."""
        self._close_views()
        self.jaw._close_views()
        for source in (*self._cp.values(), *self._local.values(), self._jacobian):
            source.close()
        self._watch.close()
        self._remote.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class System:
    """One running system; a context manager. Made by `system`."""

    def __init__(self, name: str) -> None:
        """`name` must be up."""
        self.name = name

    def arms(self) -> list[str]:
        """Names of its arms."""
        return arm_names(self.name)

    def power_on(self, timeout: float = 10.0) -> None:
        """Enable every arm; Problem says which are not and why."""
        _arms.power_on(self.name, (), timeout)

    def home(self, timeout: float = 60.0) -> None:
        """Home every arm, enabling those that are not."""
        _arms.home(self.name, (), timeout)

    def power_off(self, timeout: float = 10.0) -> None:
        """Disable every arm."""
        _arms.power_off(self.name, (), timeout)

    def status(self) -> list[Life]:
        """Every process: state, rate, missed deadlines, restarts, trouble."""
        return lives(self.name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        """Nothing is held open between calls."""


def arm(name: str, system: str | None = None, timeout: float = 5.0) -> Arm:
    """The arm `name`, once it is connected; TimeoutError after `timeout` s. `system`: default the only one up."""
    return _connected(lambda: _attached(name, system), timeout, name)


def system(name: str | None = None, timeout: float = 5.0) -> System:
    """A running system, default the only one up; TimeoutError when there is none within `timeout` s."""
    return _connected(lambda: System(chosen_system(name)), timeout, name or "a system")


def _attached(name: str, system: str | None) -> Arm:
    found = Arm(chosen_system(system), name)
    if found.connected():
        return found
    found.close()
    raise Problem(f"{name} does not show its state; is it running?")


def _connected(attach: Callable[[], T], timeout: float, what: str) -> T:
    end = monotonic_ns() + round(timeout * 1e9)
    while True:
        try:
            return attach()
        except (Problem, SegmentError) as error:
            if monotonic_ns() >= end:
                raise TimeoutError(f"{what} is not connected after {timeout:g} s: {error}") from None
            pause(TRY_AGAIN_S)


def _until(done: Callable[[], bool], timeout: float, what: str) -> None:
    end = monotonic_ns() + round(timeout * 1e9)
    while not done():
        if monotonic_ns() >= end:
            raise TimeoutError(f"{what} after {timeout:g} s")
        pause(POLL_S)


def _numbers(values: ArrayLike | Sequence[float]) -> Array:
    return np.asarray(values, dtype=np.float64).reshape(-1)


def _fresh(source: Source) -> None:
    if not source.newest() or source.age_s > FRESH_S:
        raise TimeoutError(f"{source.entry.name}: nothing came for {FRESH_S:g} s")
    if not source.valid:
        raise TimeoutError(f"{source.entry.name} is not valid now (is the arm powered and homed?)")


def _part(source: Source, name: str) -> Stamped:
    _fresh(source)
    value: Array = source.part(name)
    return value, source.stamp_ns


def _joint_state(source: Source) -> tuple[JointState, int]:
    _fresh(source)
    parts: list[Any] = [source.part(name) for name in JointState._fields]
    return JointState(*parts), source.stamp_ns


def _pose(source: Source) -> Stamped:
    _fresh(source)
    return matrix_from_pose(source.part("pose")), source.stamp_ns
