"""What an arm does with each command of its table: check it, change the motion, answer it.

Every command is answered. What is carried out at once is answered by `done`; a move by `accept`, then by `done` when
it has arrived or `fail` when it has not. A refused command says why; a refused move also gives its busy pair, so that
nobody waits for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from procs.arm.joints import AXES, Joints
from procs.arm.machine import Machine, Request
from procs.arm.motion import Mode, Motion
from procs.arm.readings import Readings
from procs.arm.states import State
from procs.lib.poses import PoseError, matrix_from_pose, unit_quaternion

Array = NDArray[np.float64]

CLIP_EPISODE_NS = 500_000_000
NOT_READY_NS = 2_000_000_000
QUATERNION_SLACK = 0.1
JAW = AXES - 1
LATER = "not available in this version"
MOVES = frozenset(("move_jp", "move_jr", "move_cp", "jaw/move_jp"))


class Refused(Exception):
    """A command that will not be carried out; the text says why."""


class Settings(Protocol):
    """What commands change besides the motion."""

    def command_state(self, request: Request) -> None:
        """A state_command."""

    def set_base(self, base: Array | None, frame: str) -> None:
        """Another base frame; None: unknown."""

    def set_tool(self, name: str) -> None:
        """Another instrument; Refused when it cannot be."""

    def show_ratios(self) -> None:
        """The ratios have changed."""


class Commands:
    """Carries out the commands of one arm."""

    def __init__(self, machine: Machine, motion: Motion, io: Readings, joints: Joints, settings: Settings) -> None:
        """`joints` is replaced when the instrument changes."""
        self.joints = joints
        self._machine, self._motion, self._io, self._settings = machine, motion, io, settings
        self._moves: dict[str, Request] = {}
        self._now_ns = 0
        self._clipped = np.zeros(AXES, dtype=np.bool_)
        self._clipped_ns = self._not_ready_ns = -NOT_READY_NS
        self._goal = np.zeros(AXES)
        self._velocity = np.zeros(AXES)
        self._table: dict[str, Callable[[Request], str | None]] = {
            "servo_jp": self._servo_jp,
            "servo_jr": self._servo_jr,
            "servo_jf": self._servo_jf,
            "move_jp": self._move_jp,
            "move_jr": self._move_jr,
            "jaw/servo_jp": self._jaw_servo_jp,
            "jaw/move_jp": self._jaw_move_jp,
            "jaw/servo_jf": self._jaw_servo_jf,
            "hold": self._hold,
            "free": self._free,
            "trajectory_j/set_ratio": self._set_ratio,
            "trajectory_j/set_ratio_v": self._set_ratio_v,
            "trajectory_j/set_ratio_a": self._set_ratio_a,
            "set_base_frame": self._set_base_frame,
            "set_tool_type": self._set_tool_type,
        }

    def run(self, requests: Iterable[Request], now_ns: int) -> None:
        """Carry out what came in, in order."""
        self._now_ns = now_ns
        for request in requests:
            if request.name == "state_command":
                self._settings.command_state(request)
            else:
                self._one(request)

    def move_ended(self, reached: bool, reason: str = "") -> None:
        """The move that ran has ended, at its goal or before it, for `reason`."""
        machine = self._machine
        machine.moving = False
        for request in self._moves.values():
            if reached:
                request.done()
            else:
                request.fail(reason)
        self._moves.clear()
        machine.reports.goal_reached(reached)
        machine.publish()

    def stop(self, position: Array, mode: Mode, reason: str) -> None:
        """Whatever runs, stay at `position` (7,) from now on."""
        if self._motion.hold(position, mode) and self._machine.moving:
            self.move_ended(False, reason)

    def _one(self, request: Request) -> None:
        handler = self._table.get(request.name)
        try:
            if handler is None:
                raise Refused(f"{request.name} is {LATER}")
            if not np.isfinite(request.values).all():
                raise Refused("values must be finite numbers")
            text = handler(request)
        except (Refused, PoseError) as error:
            request.refuse(str(error))
            if request.name in MOVES:
                self._machine.publish_refused_move()
            return
        if text is not None:
            request.done(text)

    def _need_homed(self, request: Request) -> None:
        state = self._machine.state
        if state is State.HOMED:
            return
        reason = f"{request.name}: arm not ready, it is in {state} and must be in {State.HOMED}"
        if self._now_ns - self._not_ready_ns >= NOT_READY_NS:
            self._not_ready_ns = self._now_ns
            name = self._machine.name
            self._machine.reports.warning("not-ready", f"{name}: {reason}", name)
        raise Refused(reason)

    def _arm_values(self, request: Request) -> Array:
        self._need_homed(request)
        n = self.joints.count
        if len(request.values) != n:
            raise Refused(f"{request.name} takes {n} values, {len(request.values)} were given")
        return request.values

    def _jaw_value(self, request: Request) -> float:
        self._need_homed(request)
        if not self.joints.has_jaw:
            raise Refused(f"{request.name}: there is no instrument, so no jaw")
        if len(request.values) != 1:
            raise Refused(f"{request.name} takes 1 value, {len(request.values)} were given")
        return float(request.values[0])

    def _clip(self) -> tuple[NDArray[np.bool_], str]:
        """Bring `_goal` into the limits; what was clipped is in the answer, and once an episode a warning."""
        outside = self.joints.clip(self._goal)
        if not outside.any():
            return outside, ""
        if self._now_ns - self._clipped_ns >= CLIP_EPISODE_NS:
            self._clipped[...] = False
        self._clipped_ns = self._now_ns
        names = ", ".join(self.joints.name(int(i)) for i in outside.nonzero()[0])
        if (outside & ~self._clipped).any():
            self._clipped |= outside
            name = self._machine.name
            self._machine.reports.warning("clipped", f"{name}: clipped to the joint limits: {names}", name)
        return outside, f"clipped: {names}"

    def _base(self) -> None:
        """`_goal` := where all joints are kept now; a servo command then changes its own part of it."""
        self._goal[...] = self._io.setpoint if self._motion.mode is Mode.EFFORT else self._motion.goal

    def _follow(self, velocity: Array | None = None) -> str:
        outside, text = self._clip()
        if velocity is not None:
            self._velocity[outside] = 0.0
        if self._motion.servo(self._goal, velocity, self._now_ns):
            self.move_ended(False, "replaced by a servo command")
        return text

    def _servo_jp(self, request: Request) -> str:
        n, values = self.joints.count, request.values
        velocity = None
        if len(values) == 2 * n:
            self._need_homed(request)
            self._velocity[:n], self._velocity[n:] = values[n:], 0.0
            velocity = self._velocity
        else:
            self._arm_values(request)
        self._base()
        self._goal[:n] = values[:n]
        return self._follow(velocity)

    def _servo_jr(self, request: Request) -> str:
        values = self._arm_values(request)
        self._base()
        if not self._motion.pending_since(self._now_ns):  # else on top of the goal given in this very cycle
            self._goal[: len(values)] = self._io.setpoint[: len(values)]
        self._goal[: len(values)] += values
        return self._follow()

    def _servo_jf(self, request: Request) -> str:
        values = self._arm_values(request)
        effort = np.zeros(AXES)
        if self._motion.mode is Mode.EFFORT:
            effort[...] = self._motion.effort
        effort[: len(values)] = values
        self._push(effort)
        return ""

    def _jaw_servo_jp(self, request: Request) -> str:
        value = self._jaw_value(request)
        self._base()
        self._goal[JAW] = value
        _, text = self._clip()
        if self._motion.adjust(self._goal, self._now_ns):
            self.move_ended(False, "replaced by a servo command")
        return text

    def _jaw_servo_jf(self, request: Request) -> str:
        value = self._jaw_value(request)
        if self._motion.mode is not Mode.EFFORT:
            raise Refused("jaw/servo_jf: the arm is not in effort mode; send servo_jf or free first")
        effort = self._motion.effort.copy()
        effort[JAW] = value
        self._push(effort)
        return ""

    def _push(self, effort: Array) -> None:
        if self._motion.push(effort):
            self.move_ended(False, "replaced by an effort command")

    def _target(self) -> None:
        """`_goal` := where the joints are going now."""
        if self._motion.mode is Mode.EFFORT:
            self._motion.hold(self._io.setpoint)
        self._goal[...] = self._motion.target

    def _move_jp(self, request: Request) -> None:
        values = self._arm_values(request)
        self._target()
        self._goal[: len(values)] = values
        self._start(request, "move")

    def _move_jr(self, request: Request) -> None:
        values = self._arm_values(request)
        self._target()
        self._goal[: len(values)] += values
        self._start(request, "move")

    def _jaw_move_jp(self, request: Request) -> None:
        value = self._jaw_value(request)
        self._target()
        self._goal[JAW] = value
        self._start(request, "jaw move")

    def _start(self, request: Request, what: str) -> None:
        _, text = self._clip()
        reason = self._motion.move(self._goal, self._io.velocity, self._now_ns)
        if reason:
            raise Refused(f"{request.name}: {reason}")
        replaced = self._moves.pop(what, None)
        if replaced is not None:
            replaced.fail(f"replaced by a newer {what}")
        self._moves[what] = request
        request.accept(text)
        self._machine.moving = True
        self._machine.publish()

    def _hold(self, request: Request) -> str:
        self._need_homed(request)
        self.stop(self._io.setpoint, Mode.POSITION, "replaced by hold")
        return ""

    def _free(self, request: Request) -> str:
        self._need_homed(request)
        self._push(np.zeros(AXES))
        return ""

    def _ratio(self, request: Request) -> float:
        values = request.values
        if len(values) != 1 or not 0.0 < values[0] <= 1.0:
            reason = "ratio must be within ]0;1]"
            name = self._machine.name
            self._machine.reports.warning("ratio", f"{name}: {request.name}: {reason}", name)
            raise Refused(f"{request.name}: {reason}")
        return float(values[0])

    def _set_ratio(self, request: Request) -> str:
        ratio = self._ratio(request)
        return self._set_ratios(ratio, ratio)

    def _set_ratio_v(self, request: Request) -> str:
        return self._set_ratios(self._ratio(request), self._motion.ratio_a)

    def _set_ratio_a(self, request: Request) -> str:
        return self._set_ratios(self._motion.ratio_v, self._ratio(request))

    def _set_ratios(self, v: float, a: float) -> str:
        self._motion.set_ratio(v, a, self._now_ns)
        self._settings.show_ratios()
        return ""

    def _set_base_frame(self, request: Request) -> str:
        values = request.values
        if len(values) == 0:
            self._settings.set_base(None, request.text)
            return "base frame unknown: only local poses are valid"
        if len(values) != 7:
            raise Refused(f"set_base_frame takes 7 values or none, {len(values)} were given")
        pose = values.copy()
        pose[3:] = unit_quaternion(values[3:], QUATERNION_SLACK)
        self._settings.set_base(matrix_from_pose(pose), request.text)
        return ""

    def _set_tool_type(self, request: Request) -> str:
        if self._machine.moving or self._machine.state is State.HOMING or self._motion.mode is Mode.EFFORT:
            raise Refused("set_tool_type: the arm is moving or in effort mode")
        self._settings.set_tool(request.text.strip())
        return ""
