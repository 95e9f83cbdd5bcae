"""Reads of one set of joints: an arm's, a jaw's, a gripper's, a setup arm's."""

from __future__ import annotations

from trocar.tools.client.values import JointState, Stamped
from trocar.tools.client.ways import RecordWay


class Measured:
    """Where joints are."""

    def __init__(self, record: RecordWay, prefix: str) -> None:
        """`prefix` of the names of their views."""
        self._record, self._prefix = record, prefix

    def measured_js(self) -> tuple[JointState, int]:
        """Measured positions, velocities and efforts."""
        return self._record.joint_state(f"{self._prefix}measured_js")

    def measured_jp(self) -> Stamped:
        """Measured positions (n,)."""
        return self._record.part(f"{self._prefix}measured_js", "position")

    def measured_jv(self) -> Stamped:
        """Measured velocities (n,)."""
        return self._record.part(f"{self._prefix}measured_js", "velocity")

    def measured_jf(self) -> Stamped:
        """Measured efforts (n,)."""
        return self._record.part(f"{self._prefix}measured_js", "effort")

    def joint_names(self) -> list[str]:
        """Their names, in order."""
        return self._record.joint_names(f"{self._prefix}measured_js")


class Setpoint:
    """What the joint controller was last given."""

    def __init__(self, record: RecordWay, prefix: str) -> None:
        """`prefix` of the names of their views."""
        self._record, self._prefix = record, prefix

    def setpoint_js(self) -> tuple[JointState, int]:
        """Positions, velocities and efforts that it was given."""
        return self._record.joint_state(f"{self._prefix}setpoint_js")

    def setpoint_jp(self) -> Stamped:
        """Positions (n,)."""
        return self._record.part(f"{self._prefix}setpoint_js", "position")

    def setpoint_jv(self) -> Stamped:
        """Velocities (n,)."""
        return self._record.part(f"{self._prefix}setpoint_js", "velocity")

    def setpoint_jf(self) -> Stamped:
        """Efforts (n,)."""
        return self._record.part(f"{self._prefix}setpoint_js", "effort")


class Joints(Measured, Setpoint):
    """Both."""
