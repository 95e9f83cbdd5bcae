"""Setup joints: where the arms of a patient cart stand."""

from __future__ import annotations

from numpy.typing import ArrayLike

from trocar.procs.crtk.names import none_such
from trocar.tools.client.instance import Instance
from trocar.tools.client.moves import MoveHandle, Waits, move
from trocar.tools.client.parts import Measured
from trocar.tools.client.values import Stamped, numbers, pose_numbers
from trocar.tools.client.ways import CommandWay, RecordWay, Ways
from trocar.tools.output.errors import Problem


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
        """Pose (4, 4) in the tip of the reference arm: the carried arm's base frame."""
        return self._record.pose(f"{self._prefix}measured_cp")

    def servo_jp(self, position: ArrayLike) -> None:
        """Be at these joints (n,) from now on; KINEMATIC ones only."""
        self._remote.ask("servo_jp", numbers(position), self.name)

    def move_jp(self, position: ArrayLike) -> MoveHandle:
        """The same; it is done at once."""
        return move(self._waits, self._remote, "move_jp", position, self.name)

    def clutch(self, on: bool = True) -> None:
        """Let its brakes go, as its button does, for a minute at most; False: they hold."""
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
        """Be at this pose (4, 4) from now on; SUJ_Fixed only."""
        self._remote.ask("local/servo_cp", pose_numbers(pose), self._name)


class Suj(Instance):
    """The setup joints of a patient cart: `suj.PSM1`, or `suj.arm("PSM1")`, is one of its arms."""

    def __init__(self, system: str | Ways, name: str) -> None:
        """Attach; Problem or SegmentError when they are not there (yet)."""
        super().__init__(system, name)
        names = self._record.parts()
        self._arms = {arm: SetupArm(self._record, self._remote, self._waits, arm) for arm in names}

    def arms(self) -> list[str]:
        """Names of its arms."""
        return list(self._arms)

    def arm(self, name: str) -> SetupArm:
        """One of them; Problem says which there are."""
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
        """The setup arm in the tip of whose arm base frames are given."""
        return self._record.look().text("reference_arm")

    def set_reference_arm(self, name: str) -> None:
        """Give base frames in the tip of the arm on this one from now on."""
        self._remote.ask("set_reference_arm", text=name)

    def set_lift_velocity(self, velocity: float) -> None:
        """Move the lift, -1 down to 1 up, for a second at most; 0: stop."""
        self._remote.ask("set_lift_velocity", (velocity,))
