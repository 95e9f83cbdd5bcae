"""One arm of a system, hosted or running, as an environment sees and commands it."""

from __future__ import annotations

from trocar.procs.crtk.plain import plain
from trocar.procs.document.walls import AT_WALL
from trocar.procs.kinematics.poses import Array
from trocar.shm.mailbox.client import Client
from trocar.shm.ring.ring import RingReader

ENABLED, HOMED = b"ENABLED", "HOMED"
REFUSED = ("refused", "failed")


class ArmLink:
    """The newest state record of an arm, after each `look`, and its mailbox."""

    def __init__(self, name: str, reader: RingReader, client: Client) -> None:
        """The caller closes both."""
        self.name, self._reader, self._client = name, reader, client
        self._valid, self._posed = reader.field("valid"), reader.field("reference_valid")
        self._position, self._velocity = reader.field("position"), reader.field("velocity")
        self._setpoint, self._jaw_setpoint = reader.field("setpoint_position"), reader.field("jaw_setpoint_position")
        self._jaw, self._pose, self._base = reader.field("jaw_position"), reader.field("measured_cp"), \
            reader.field("base_frame")
        self._state, self._homed, self._reason = reader.field("state"), reader.field("is_homed"), \
            reader.field("reason")
        self._busy, self._sub_state = reader.field("is_busy"), reader.field("sub_state")
        self._frame, self._carried = reader.field("reference_frame"), reader.field("tool")
        self._count = reader.field("count")
        self._ratio = reader.field("trajectory_ratio_v"), reader.field("trajectory_ratio_a")
        self.stamp_ns = 0
        self.refusal = self.wall = ""
        """Why a command of ours was refused since `forget`, and at which wall the arm was; empty: none."""
        self.refusals = 0
        """Number of consecutive refusals received."""

    def look(self) -> bool:
        """Take the newest record; False: there is none."""
        if not self._reader.newest():
            return False
        self.stamp_ns = self._reader.stamp_ns
        return True

    @property
    def is_ready(self) -> bool:
        """Whether the arm can be commanded: it is powered and homed, and its values are valid."""
        return bool(self._state[()] == ENABLED and self._homed[()] and self._valid[()] and self._posed[()])

    @property
    def is_busy(self) -> bool:
        """Whether a move or a change of the arm's state is in progress."""
        return bool(self._busy[()])

    @property
    def doing(self) -> str:
        """Why it is busy: its internal state, MANUAL if moved by hand; "moving" if it is homed."""
        doing = str(plain(self._sub_state.item()))
        return "moving" if doing == HOMED else doing

    @property
    def problem(self) -> str:
        """Why it cannot be commanded; empty: it can."""
        if self.is_ready:
            return ""
        what = f"{self.name} is {self.state}" + ("" if self._homed[()] else " and not homed")
        why = self.reason
        if not why and self._homed[()]:
            why = "its base frame is not known" if self._valid[()] else "its joints are not valid"
        return what + (f": {why}" if why else "")

    @property
    def state(self) -> str:
        """Its operating state."""
        return str(plain(self._state.item()))

    @property
    def reason(self) -> str:
        """Why it is in FAULT, or the condition it waits for."""
        return str(plain(self._reason.item()))

    @property
    def frame(self) -> str:
        """Frame of its poses."""
        return str(plain(self._frame.item()))

    @property
    def carried(self) -> str:
        """Its instrument or endoscope."""
        return str(plain(self._carried.item()))

    @property
    def count(self) -> int:
        """Of its joints."""
        return int(self._count[()])

    @property
    def ratios(self) -> tuple[float, float]:
        """Of velocity and acceleration, in moves."""
        return float(self._ratio[0][()]), float(self._ratio[1][()])

    @property
    def base(self) -> Array:
        """Pose (7,) of its base in that frame."""
        return self._base.copy()

    def joints(self, count: int) -> tuple[Array, Array, float]:
        """Measured positions (count,), velocities (count,), and the jaw; views that the next look changes."""
        return self._position[:count], self._velocity[:count], float(self._jaw[()])

    def setpoint(self, count: int) -> tuple[Array, float]:
        """Current setpoints of joints (count,) and jaw."""
        return self._setpoint[:count].copy(), float(self._jaw_setpoint[()])

    def pose(self) -> Array:
        """Measured pose (7,) of the tip; a view that the next look changes."""
        return self._pose

    def send(self, command: str, values: Array | tuple[float, ...] = (), text: str = "") -> int:
        """Send a command; returns its number. MailboxFull or SegmentError if it is not accepted."""
        return self._client.send(command, values, text)

    def forget(self) -> None:
        """A step begins: earlier refusals and walls no longer count."""
        self.refusal = self.wall = ""

    def hear(self, number: int = 0) -> str:
        """Read answers; returns the outcome of command `number`, if it has ended, else empty."""
        ended, was_refused = "", False
        for reply in self._client.poll():
            if reply.outcome in REFUSED:
                self.refusal, was_refused = self.refusal or reply.text or reply.outcome, True
            self.wall = reply.text.partition(AT_WALL)[2] or self.wall
            if reply.id == number and reply.outcome != "accepted":
                ended = reply.outcome
        self.refusals = self.refusals + 1 if was_refused else 0
        return ended
