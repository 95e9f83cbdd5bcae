"""One arm of a running system, with the methods common to all kinds of arms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trocar.tools.client.instance import Instance
from trocar.tools.client.moves import CLIPPED, MoveHandle, move, warn
from trocar.tools.client.parts import Body, Frame, Joints, Local, Setpoint, asked, asked_pose
from trocar.tools.client.values import Array, Impedance, Stamped, numbers, pose_numbers, six_numbers
from trocar.tools.client.ways import Ways
from trocar.tools.output.errors import Clipped

LIMITED: Final = ("at its limit: ", CLIPPED)
"""The answer to an unreachable goal begins with one of these."""


class Arm(Instance, Joints):
    """Read and command an arm. Poses are in the reference frame, those of `local` in the arm's base frame.

    `frame`: the frame of a command's values, e.g. "PSM1_base", as over ROS (docs/ros.md); by default, the
    reference frame. Refused for a frame that the arm does not know.
    """

    def __init__(self, ways: Ways, name: str) -> None:
        """Attach; Problem or SegmentError when the arm is not there (yet)."""
        Instance.__init__(self, ways, name)
        Joints.__init__(self, self._record, "")
        self.local = Local(self._record, self._remote)
        self.body = Body(self._record, self._remote, "body")
        self.spatial = Frame(self._record, self._remote, "spatial")
        self.gravity_compensation = Setpoint(self._record, "gravity_compensation/")
        self._is_limited = False

    # the tip

    def measured_cp(self) -> Stamped:
        """Measured tip pose (4, 4)."""
        return self._record.pose("measured_cp")

    def setpoint_cp(self) -> Stamped:
        """Setpoint tip pose (4, 4)."""
        return self._record.pose("setpoint_cp")

    def measured_cv(self) -> Stamped:
        """Measured twist (6,) of the tip, linear then angular."""
        return self._record.part("measured_cv", "twist")

    def setpoint_cv(self) -> Stamped:
        """Twist (6,) of the setpoint tip."""
        return self._record.part("setpoint_cv", "twist")

    def measured_cf(self) -> Stamped:
        """The same as `body.measured_cf`."""
        return self.body.measured_cf()

    def move_cp(self, pose: ArrayLike, frame: str = "") -> MoveHandle:
        """Move to a tip pose (4, 4), in a straight line in joint space."""
        return move(self._waits, self._remote, "move_cp", pose_numbers(pose), frame)

    def move_cr(self, change: ArrayLike, frame: str = "") -> MoveHandle:
        """Move the tip by a translation and a rotation about itself (4, 4)."""
        return move(self._waits, self._remote, "move_cr", pose_numbers(change), frame)

    def servo_cp(self, pose: ArrayLike, twist: ArrayLike | None = None, frame: str = "") -> None:
        """Follow a tip pose (4, 4) now, with its optional twist (6,)."""
        values = pose_numbers(pose)
        if twist is not None:
            values = np.concatenate((values, six_numbers(twist, "a twist")))
        self._follow("servo_cp", values, frame)

    def servo_cr(self, change: ArrayLike, frame: str = "") -> None:
        """Follow the setpoint pose plus a translation and a rotation about its tip (4, 4)."""
        self._follow("servo_cr", pose_numbers(change), frame)

    def servo_cs(self, pose: ArrayLike | None = None, twist: ArrayLike | None = None,
                 wrench: ArrayLike | None = None, frame: str = "") -> None:
        """Follow a pose (4, 4), with optional twist (6,) and wrench (6,); without a pose: apply the wrench."""
        values = np.zeros(7 + 6 + 6 + 3)
        if pose is not None:
            values[:7] = pose_numbers(pose)
        if twist is not None:
            values[7:13] = six_numbers(twist, "a twist")
        if wrench is not None:
            values[13:19] = six_numbers(wrench, "a wrench")
        values[19:] = pose is not None, twist is not None, wrench is not None
        self._follow("servo_cs", values, frame)

    def servo_cf(self, wrench: ArrayLike, frame: str = "") -> None:
        """The same as `body.servo_cf`."""
        self._remote.ask("servo_cf", six_numbers(wrench, "a wrench"), frame)

    def servo_ci(self, impedance: Impedance, frame: str = "") -> None:
        """Apply spring-damper forces about a position and an orientation, for `arm.effort_timeout_s` (0.1 s)."""
        self._remote.ask("servo_ci", impedance.numbers(), frame)

    # joints

    def move_jp(self, position: ArrayLike) -> MoveHandle:
        """Move to joint positions (n,) and stop there."""
        return move(self._waits, self._remote, "move_jp", position)

    def move_jr(self, increment: ArrayLike) -> MoveHandle:
        """Move by joint increments (n,)."""
        return move(self._waits, self._remote, "move_jr", increment)

    def servo_jp(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Follow joint positions (n,) now, with their optional velocities (n,)."""
        values = numbers(position)
        self._follow("servo_jp", values if velocity is None else np.concatenate((values, numbers(velocity))))

    def servo_jr(self, increment: ArrayLike) -> None:
        """Follow the setpoint plus these increments (n,)."""
        self._follow("servo_jr", numbers(increment))

    def servo_jv(self, velocity: ArrayLike) -> None:
        """Move at these joint velocities (n,) until 0.1 s after the last such command."""
        self._follow("servo_jv", numbers(velocity))

    def servo_jf(self, effort: ArrayLike) -> None:
        """Apply joint efforts (n,), N·m and N, for `arm.effort_timeout_s` (0.1 s); zeros do not time out."""
        self._remote.ask("servo_jf", numbers(effort))

    def _follow(self, command: str, values: ArrayLike, frame: str = "") -> None:
        """A goal of a stream. That it cannot be reached is warned of (`Clipped`), once until one is reached again."""
        answer = self._remote.ask(command, values, frame).text
        is_limited = answer.startswith(LIMITED)
        if is_limited and not self._is_limited:
            warn(f"{self.name} {command}: {answer}", Clipped)
        self._is_limited = is_limited

    def hold(self) -> None:
        """End motion and hold the setpoint. Powered but not homed: pauses; `state_command("resume")` continues."""
        self._remote.ask("hold")

    def free(self) -> None:
        """Zero efforts except gravity compensation; the arm can be moved by hand."""
        self._remote.ask("free")

    def pause(self, timeout: float = 10.0) -> None:
        """Pause and wait until it is PAUSED; moves end."""
        self.state_command("pause")
        self.wait_for_operating_state("PAUSED", timeout)

    def resume(self, timeout: float = 10.0) -> None:
        """Resume after a pause and wait until it is ENABLED."""
        self.state_command("resume")
        self.wait_for_operating_state("ENABLED", timeout)

    # settings

    def trajectory_j_set_ratio(self, ratio: float) -> None:
        """Speed and acceleration of moves, above 0 up to 1; also of the move under way."""
        self._remote.ask("trajectory_j/set_ratio", (ratio,))

    def trajectory_j_set_ratio_v(self, ratio: float) -> None:
        """Like `trajectory_j_set_ratio`, for speed only."""
        self._remote.ask("trajectory_j/set_ratio_v", (ratio,))

    def trajectory_j_set_ratio_a(self, ratio: float) -> None:
        """Like `trajectory_j_set_ratio`, for acceleration only."""
        self._remote.ask("trajectory_j/set_ratio_a", (ratio,))

    def trajectory_j_get_ratio(self) -> float:
        """The ratio in use; 0: speed and acceleration differ."""
        return self._ratio("trajectory_ratio")

    def trajectory_j_get_ratio_v(self) -> float:
        """The speed ratio in use."""
        return self._ratio("trajectory_ratio_v")

    def trajectory_j_get_ratio_a(self) -> float:
        """The acceleration ratio in use."""
        return self._ratio("trajectory_ratio_a")

    def _ratio(self, field: str) -> float:
        return self._record.look().number(field)

    def use_gravity_compensation(self, on: bool = True) -> None:
        """Compensate the arm's own weight, or not; Refused without a model of it."""
        self._remote.ask("use_gravity_compensation", (float(on),))

    def set_base_frame(self, pose: ArrayLike | None, frame: str = "") -> None:
        """Set the pose (4, 4) of the arm's base in a reference frame of this name; None: unknown (`local` only)."""
        self._remote.ask("set_base_frame", () if pose is None else pose_numbers(pose), frame)

    def add_wall(self, name: str, shape: str, pose: ArrayLike, size: Sequence[float] = (), margin: float = 0.0, *,
                 keep: str = "out", of: str = "instrument", frame: str = "base") -> None:
        """Keep a part of the arm out of a shape at a pose (4, 4), or `keep="in"` it; docs/walls.md has all words."""
        self._remote.ask("add_wall", (*pose_numbers(pose), *size, margin), f"{name} {shape} {keep} {of} {frame}")

    def remove_wall(self, name: str) -> None:
        """Remove a wall; an operator's command."""
        self._remote.ask("remove_wall", (), name)

    def reference_frame(self) -> str:
        """Name of the frame of its poses."""
        return self._record.look().text("reference_frame")

    # queries; no motion

    def forward_kinematics(self, position: ArrayLike) -> Array:
        """Pose (4, 4) of the tip at joint positions (n,); with fewer positions: of the frame after the last of them."""
        return asked_pose(self._remote, "forward_kinematics", position)

    def inverse_kinematics(self, seed: ArrayLike, pose: ArrayLike) -> Array:
        """Joints (n,) for a tip pose (4, 4) in the arm's base (not the reference frame), near the seed (n,).

        Refused with the reason if there are none.
        """
        return asked(self._remote, "inverse_kinematics", np.concatenate((numbers(seed), pose_numbers(pose))))

    def actuator_to_joint_position(self, position: ArrayLike) -> Array:
        """Joint positions for positions of all actuators."""
        return asked(self._remote, "actuator_to_joint_position", position)

    def crtk_version(self) -> str:
        """Version of CRTK that the commands follow."""
        return self._remote.ask("crtk_version").text
