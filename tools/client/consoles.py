"""Consoles and teleoperations, with the words of dvrk_python."""

from __future__ import annotations

from trocar.procs.crtk.names import none_such
from trocar.shm.operator_topics import TeleopState
from trocar.tools.client.instance import InstanceHandle, known_state
from trocar.tools.client.ways import Ways
from trocar.tools.output.errors import Problem


class Operated(InstanceHandle):
    """A console or a teleoperation of a running system; a context manager. Each thread has to make its own."""

    def __init__(self, ways: Ways, name: str) -> None:
        """Attach; Problem or SegmentError if it is not there (yet)."""
        super().__init__(ways, name, reports_fields=True)


class ConsoleHandle(Operated):
    """A console: an operator's pedals, and the teleoperations that they control."""

    def teleop_start(self) -> None:
        """Enable the selected teleoperations; the operator's pedals control them from now on."""
        self._remote.ask("teleop_enable", (1.0,))

    def teleop_stop(self) -> None:
        """Disable all teleoperations."""
        self._remote.ask("teleop_enable", (0.0,))

    def teleop_enabled(self) -> bool:
        """Whether teleoperation is enabled."""
        return bool(self._record.row()["teleop_enabled"])

    def teleops(self) -> list[str]:
        """Names of its teleoperations."""
        return [str(name) for name in self._record.row()["teleop"]]

    def teleop_select(self, name: str) -> None:
        """Select a teleoperation; those that share an arm with it are unselected."""
        self._remote.ask("select_teleop", text=name)

    def teleop_unselect(self, name: str) -> None:
        """Unselect it."""
        self._remote.ask("unselect_teleop", text=name)

    def teleop_is_selected(self, name: str) -> bool:
        """Whether it is selected; Problem if there is none of that name."""
        row = self._record.row()
        if name not in row["teleop"]:
            raise Problem(none_such("teleoperation", name, row["teleop"]))
        return bool(row["selected"][row["teleop"].index(name)])

    def teleop_set_scale(self, scale: float) -> None:
        """Ratio of the slave's motion to the master's, above 0, for all its teleoperations."""
        self._remote.ask("set_scale", (scale,))

    def teleop_get_scale(self) -> float:
        """The scale last requested."""
        return float(self._record.row()["scale"])

    def operator_present(self) -> bool:
        """Whether the operator is present."""
        return bool(self._record.row()["operator_present"])

    def clutch(self) -> bool:
        """Whether the clutch is pressed."""
        return bool(self._record.row()["clutch"])

    def camera(self) -> bool:
        """Whether the camera pedal is pressed."""
        return bool(self._record.row()["camera"])

    def emulate_operator_present(self, present: bool = True) -> None:
        """Emulate that the operator comes or goes."""
        self._remote.ask("emulate_operator_present", (float(present),))

    def emulate_clutch(self, pressed: bool = True) -> None:
        """Emulate that the clutch is pressed, or released."""
        self._remote.ask("emulate_clutch", (float(pressed),))

    def emulate_camera(self, pressed: bool = True) -> None:
        """Emulate that the camera pedal is pressed, or released."""
        self._remote.ask("emulate_camera", (float(pressed),))


class TeleopHandle(Operated):
    """One teleoperation."""

    def current_state(self) -> str:
        """DISABLED, SETTING_ARMS_STATE, ALIGNING_MTM or ENABLED."""
        return str(self._record.row()["state"])

    def desired_state(self) -> str:
        """The requested state."""
        return str(self._record.row()["desired_state"])

    def following(self) -> bool:
        """Whether the slave follows."""
        return bool(self._record.row()["following"])

    def reason(self) -> str:
        """The condition it waits for, or the reason why it does not follow; empty: none."""
        return str(self._record.row()["reason"])

    def state_command(self, word: str) -> None:
        """Request a state: enable, align_MTM or disable."""
        self._remote.ask("state_command", text=word)

    def enable(self, timeout: float = 60.0) -> None:
        """Enable it and wait until it is ENABLED, with its arms homed and aligned and the operator present."""
        self.state_command("enable")
        self.wait_for_state("ENABLED", timeout)

    def disable(self, timeout: float = 10.0) -> None:
        """Disable it and wait until it is DISABLED."""
        self.state_command("disable")
        self.wait_for_state("DISABLED", timeout)

    def wait_for_state(self, state: str, timeout: float = 10.0) -> None:
        """Wait until it is DISABLED, SETTING_ARMS_STATE, ALIGNING_MTM or ENABLED; TimeoutError after `timeout` s."""
        known_state(state, [*TeleopState])
        self._waits.until(lambda: self.current_state() == state, timeout, f"{self.name} is not {state}")

    def set_scale(self, scale: float) -> None:
        """Ratio of the slave's motion to the master's, above 0."""
        self._remote.ask("set_scale", (scale,))

    def get_scale(self) -> float:
        """The scale in use."""
        return float(self._record.row()["scale"])

    def lock_rotation(self, on: bool = True) -> None:
        """Keep the slave's orientation constant."""
        self._remote.ask("lock_rotation", (float(on),))

    def lock_translation(self, on: bool = True) -> None:
        """Keep the slave's position constant."""
        self._remote.ask("lock_translation", (float(on),))

    def set_align_mtm(self, on: bool = True) -> None:
        """Align the master with the slave before following."""
        self._remote.ask("set_align_MTM", (float(on),))
