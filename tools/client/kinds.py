"""Methods that only a PSM, an ECM, an MTM or the setup joints of a patient cart have."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from trocar.procs.crtk.names import none_such
from trocar.tools.client.arm import Arm
from trocar.tools.client.instance import Instance
from trocar.tools.client.moves import MoveHandle, Waits, move
from trocar.tools.client.parts import Joints, Measured
from trocar.tools.client.values import Array, Stamped, numbers, pose_numbers, rotation_numbers
from trocar.tools.client.ways import CommandWay, RecordWay, Ways
from trocar.tools.output.errors import Problem

JAW_OPEN, JAW_CLOSED = math.radians(60.0), math.radians(-20.0)
INSERTION = 2


class Jaw(Joints):
    """The jaw of an instrument: angles in rad, shapes (1,)."""

    def __init__(self, record: RecordWay, remote: CommandWay, waits: Waits) -> None:
        """Made by `Psm`."""
        super().__init__(record, "jaw/")
        self._remote, self._waits = remote, waits

    def servo_jp(self, position: ArrayLike) -> None:
        """Follow this angle now."""
        self._remote.ask("jaw/servo_jp", numbers(position))

    def servo_jf(self, effort: ArrayLike) -> None:
        """Apply this effort (N·m) for `arm.effort_timeout_s` (0.1 s); 0 does not time out.

        The rest of the arm becomes limp unless it is already in effort mode.
        """
        self._remote.ask("jaw/servo_jf", numbers(effort))

    def move_jp(self, position: ArrayLike) -> MoveHandle:
        """Move to this angle."""
        return move(self._waits, self._remote, "jaw/move_jp", position)

    def open(self, angle: float = JAW_OPEN) -> MoveHandle:
        """Open, by default to 60°."""
        return self.move_jp(angle)

    def close(self, angle: float = JAW_CLOSED) -> MoveHandle:
        """Close, by default to −20°: the instrument grips."""
        return self.move_jp(angle)


def inserted(arm: Arm, depth: float) -> Array:
    """Its setpoint (n,) with another insertion."""
    position, _ = arm.setpoint_jp()
    position[INSERTION] = depth
    return position


class Psm(Arm):
    """An arm with an instrument."""

    def __init__(self, ways: Ways, name: str) -> None:
        """See `Arm`."""
        super().__init__(ways, name)
        self.jaw = Jaw(self._record, self._remote, self._waits)

    def insert_jp(self, depth: float) -> MoveHandle:
        """Move the insertion (m) alone; the other joints go to their present setpoints."""
        return move(self._waits, self._remote, "move_jp", inserted(self, depth), called="insert_jp")

    def tool(self) -> tuple[str, int]:
        """The instrument as NAME:MODEL[VERSION], and the time stamp; empty: no known instrument."""
        watch = self._record.look()
        return watch.text("tool"), watch.stamp_ns

    def set_tool_type(self, name: str) -> None:
        """Set the type of the inserted instrument, NAME:MODEL."""
        self._remote.ask("set_tool_type", text=name)

    def emulate_tool_present(self, present: bool = True) -> None:
        """Emulate that an instrument is inserted; False: read its switch again."""
        self._remote.ask("emulate_tool_present", (float(present),))

    def emulate_adapter_present(self, present: bool = True) -> None:
        """Emulate that a sterile adapter is attached; False: read its switch again."""
        self._remote.ask("emulate_adapter_present", (float(present),))


class Ecm(Arm):
    """An arm with an endoscope."""

    def insert_jp(self, depth: float) -> MoveHandle:
        """Move the insertion (m) alone; the other joints go to their present setpoints."""
        return move(self._waits, self._remote, "move_jp", inserted(self, depth), called="insert_jp")

    def endoscope(self) -> tuple[str, int]:
        """The endoscope type in use, and the time stamp."""
        watch = self._record.look()
        return watch.text("tool"), watch.stamp_ns

    def set_endoscope_type(self, name: str) -> None:
        """Set the type of its endoscope; Refused names the known ones."""
        self._remote.ask("set_endoscope_type", text=name)


class Gripper(Measured):
    """The gripper of a master: angles in rad, shapes (1,), valid without power as well."""

    def __init__(self, record: RecordWay, zero: float) -> None:
        """`zero` is the angle (rad) above which it is open; made by `Mtm`."""
        super().__init__(record, "gripper/")
        self._zero = zero

    def closed(self) -> bool:
        """Whether it has been closed for the time configured in its file."""
        position, _ = self.measured_jp()  # an arm that was restarted meanwhile does not report that it finds it open
        return self._record.reported("gripper/closed") and bool(position[0] <= self._zero)


class Mtm(Arm):
    """A master."""

    def __init__(self, ways: Ways, name: str) -> None:
        """See `Arm`."""
        super().__init__(ways, name)
        self.gripper = Gripper(self._record, self._ways.gripper_zero(name))

    def lock_orientation(self, rotation: ArrayLike) -> None:
        """Hold the tip's orientation (3, 3) in the reference frame, not its position. Needs Cartesian effort mode."""
        self._remote.ask("lock_orientation", rotation_numbers(rotation))

    def lock_orientation_as_is(self) -> None:
        """Hold the orientation that the tip has now."""
        self._remote.ask("lock_orientation")

    def unlock_orientation(self) -> None:
        """Release the orientation."""
        self._remote.ask("unlock_orientation")

    def orientation_locked(self) -> bool:
        """Whether the orientation is locked."""
        self._record.look()
        return self._record.reported("orientation_locked")


class SetupArm(Measured):
    """One setup arm; its poses are those of the base of the arm that it carries."""

    def __init__(self, record: RecordWay, remote: CommandWay, waits: Waits, name: str) -> None:
        """Made by `Suj`."""
        super().__init__(record, f"{name}/")
        self._remote, self._waits, self.name = remote, waits, name
        self.local = SetupLocal(record, remote, name)
        self.primary_voltage = Measured(record, f"{name}/primary_voltage/")
        self.secondary_voltage = Measured(record, f"{name}/secondary_voltage/")

    def measured_cp(self) -> Stamped:
        """Pose (4, 4) of the carried arm's base in the frame of the reference arm's tip."""
        return self._record.pose(f"{self._prefix}measured_cp")

    def servo_jp(self, position: ArrayLike) -> None:
        """Set the joint positions (n,); KINEMATIC setup joints only."""
        self._remote.ask("servo_jp", numbers(position), self.name)

    def move_jp(self, position: ArrayLike) -> MoveHandle:
        """The same as `servo_jp`; completes immediately."""
        return move(self._waits, self._remote, "move_jp", position, self.name)

    def clutch(self, on: bool = True) -> None:
        """Release its brakes, as its button does, for a minute at most; False: engage them."""
        self._remote.ask("clutch", (float(on),), self.name)


class SetupLocal:
    """A setup arm seen from the cart."""

    def __init__(self, record: RecordWay, remote: CommandWay, name: str) -> None:
        """Made by `SetupArm`."""
        self._record, self._remote, self._name = record, remote, name

    def measured_cp(self) -> Stamped:
        """Pose (4, 4) of the carried arm's base."""
        return self._record.pose(f"{self._name}/local/measured_cp")

    def servo_cp(self, pose: ArrayLike) -> None:
        """Set this pose (4, 4); SUJ_Fixed only."""
        self._remote.ask("local/servo_cp", pose_numbers(pose), self._name)


class Suj(Instance):
    """The setup joints of a patient cart: `suj.PSM1`, or `suj.arm("PSM1")`, is one of its arms."""

    def __init__(self, ways: Ways, name: str) -> None:
        """Attach; Problem or SegmentError when they are not there (yet)."""
        super().__init__(ways, name)
        names = self._record.parts()
        self._arms = {arm: SetupArm(self._record, self._remote, self._waits, arm) for arm in names}

    def arms(self) -> list[str]:
        """Names of its arms."""
        return list(self._arms)

    def arm(self, name: str) -> SetupArm:
        """One of them; Problem names the existing ones."""
        found = self._arms.get(name)
        if found is None:
            raise Problem(none_such("setup arm", name, self._arms))
        return found

    def __getattr__(self, name: str) -> SetupArm:
        arms: dict[str, SetupArm] = self.__dict__.get("_arms", {})
        if name not in arms:
            raise AttributeError(f"there is no {name}; setup arms are {', '.join(arms)}")
        return arms[name]

    def reference_arm(self) -> str:
        """The reference setup arm: base frames are relative to the tip of the arm that it carries."""
        return self._record.look().text("reference_arm")

    def set_reference_arm(self, name: str) -> None:
        """Make this the reference setup arm: base frames are relative to the tip of the arm that it carries."""
        self._remote.ask("set_reference_arm", text=name)

    def set_lift_velocity(self, velocity: float) -> None:
        """Move the lift, -1 down to 1 up, for a second at most; 0: stop."""
        self._remote.ask("set_lift_velocity", (velocity,))
