"""THE TABLE of what can be asked of a running process: one row per command, per kind of process.

A command travels as a place in its kind's table, up to 64 numbers and a short text; `values` names the numbers,
`{n}` stands for one value per joint. Replies come back on the client's reply ring.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

ENDINGS: Final = ("refused", "done", "failed")
"""Outcomes after which no other one comes."""


@dataclass(frozen=True, slots=True)
class CommandRow:
    """One command: name (CRTK where there is one), its numbers, its text, one sentence.

    `moves` marks commands after which the robot may move or change power. Such a command is refused when it comes late
    and when no person's command stands behind it (shm/origins.py), unless it only ends something or is a `level`, which
    holds until the next one says otherwise.

    It stops something when its text is among `stops` ("*": any text), or its values are all 0 and `zero` is "stops".
    For stops there is always room in a mailbox; what was asked before one is not done after it. With "frees" zeros let
    go of something that a person brought up: that must not come late, but nobody needs to have asked for it.

    `types` of arms that have it, none: all; others refuse it, and it is not listed for them. `latest`: of several that
    wait one behind the other only the newest is carried out (users' processes).
    """

    name: str
    values: str
    text: str
    doc: str
    moves: bool = True
    stops: tuple[str, ...] = ()
    zero: Literal["", "stops", "frees"] = ""
    level: bool = False
    types: tuple[str, ...] = ()
    latest: bool = False

    def is_stop(self, text: str, values: Sequence[float] | NDArray[np.float64]) -> bool:
        """Whether it stops something and starts nothing."""
        return "*" in self.stops or text in self.stops or (self.zero == "stops" and not any(values))

    def only_ends(self, text: str, values: Sequence[float] | NDArray[np.float64]) -> bool:
        """Whether it moves nothing, or only ends something: it is carried out however long it has waited."""
        return not self.moves or self.level or self.is_stop(text, values)

    def needs_person(self, text: str, values: Sequence[float] | NDArray[np.float64]) -> bool:
        """Whether a person's command has to stand behind it."""
        return not (self.only_ends(text, values) or (self.zero == "frees" and not any(values)))

    def about(self, text: str) -> str:
        """The part of the instance that it is about, the first word of its text; empty: all of it."""
        return "" if not self.text or text in self.stops else text.partition(" ")[0]

    @property
    def streams(self) -> bool:
        """Whether it is one of a stream: goals that are followed as they come."""
        return "servo_" in self.name


COMMANDS: dict[str, tuple[CommandRow, ...]] = {
    "io": (
        CommandRow("power_on", "", "robot", "close the safety relay, switch motor power on, enable the amplifiers"),
        CommandRow("power_off", "open_relays", "robot", "disable the amplifiers, switch motor power off", stops=("*",)),
        CommandRow("bias_encoders", "samples, axes to leave out or none", "robot",
                   "set encoders from potentiometers; negative samples: accept preset ones"),
        CommandRow("set_encoder", "axis, rad or m", "robot", "make the encoder of an axis at a known place read it"),
        CommandRow("pid_enable", "on", "robot", "joint controller on, or off, when brakes hold", zero="stops"),
        CommandRow("servo_zero", "", "robot", "zero efforts, joint controller off, brakes hold", stops=("*",)),
        CommandRow("enforce_limits", "on", "robot", "clip setpoints to the position limits", moves=False),
        CommandRow("tracking_check", "on", "robot", "trip on too large a tracking error", moves=False),
        CommandRow("pot_check", "on", "robot", "compare potentiometers with encoders", moves=False),
        CommandRow("use_setpoint_v", "on", "robot", "use the velocity feed of setpoints", moves=False),
        CommandRow("set_gains", "axis (-1: all), a value for each", "robot, keys of the PID file, @who or nothing",
                   "change gains of its joint controller from this cycle on"),
        CommandRow("brake_release", "", "robot", "let the brakes go; the joint controller must be on"),
        CommandRow("brake_engage", "", "robot", "let the brakes hold", moves=False),
        CommandRow("set_output", "on", "output name", "pin of a digital output high or low; a one-shot turns by itself",
                   moves=False),
        CommandRow("set_pwm", "duty", "output name", "share of the time that a digital output is high, 0 to 1",
                   zero="stops"),
        CommandRow("trigger_read", "", "instrument reader",
                   "read the memory of the instrument; done with its NAME:MODEL[VERSION]", moves=False),
        CommandRow("clear_fault", "", "robot", "forget the latched fault", moves=False),
        CommandRow("supply_on", "s", "robot",
                   "close the safety relay, motor power on for so long; amplifiers stay off"),
        CommandRow("drive_axis", "axis, A, s, travel, release its brake", "robot",
                   "let the current of one motor rise to A within s until it has moved by travel; all others are free"),
    ),
    "arm": (
        CommandRow("state_command", "", "enable|disable|home|unhome|pause|resume", "change the operating state",
                   stops=("disable", "pause")),
        CommandRow("servo_jp", "position {n}, velocity {n} or none", "", "follow these joint positions now"),
        CommandRow("servo_jr", "increment {n}", "", "follow the setpoint plus these increments"),
        CommandRow("servo_jv", "velocity {n}", "",
                   "go at these joint velocities until 0.1 s after the last such command"),
        CommandRow("servo_jf", "effort {n}", "", "apply these joint efforts, for arm.effort_timeout_s; zeros for ever",
                   zero="frees"),
        CommandRow("servo_cp", "x y z qx qy qz qw, twist or none", "", "follow this tip pose now"),
        CommandRow("servo_cr", "x y z qx qy qz qw", "", "follow the setpoint pose, shifted and turned about its tip"),
        CommandRow("servo_cs", "pose, twist, wrench, 1 or 0 for each", "",
                   "follow a pose with velocity and wrench; without a pose apply the wrench"),
        CommandRow("servo_cf", "fx fy fz tx ty tz, s or none", "", "the same as body/servo_cf", zero="frees"),
        CommandRow("body/servo_cf", "fx fy fz tx ty tz, s it lasts or none", "",
                   "apply this force and torque at the tip, in its axes, for arm.effort_timeout_s at most",
                   zero="frees"),
        CommandRow("spatial/servo_cf", "fx fy fz tx ty tz", "", "apply this force and torque at the origin of the base",
                   zero="frees"),
        CommandRow("servo_ci", "place, axes q, orientation q, gains (48)", "",
                   "push as springs and dampers about a place and an orientation do"),
        CommandRow("body/set_cf_orientation_absolute", "on", "",
                   "wrenches of the tip are in axes of the reference frame",
                   moves=False),
        CommandRow("move_jp", "position {n}", "", "move to these joint positions and stop there"),
        CommandRow("move_jr", "increment {n}", "", "move by these increments"),
        CommandRow("move_cp", "x y z qx qy qz qw", "", "move to this tip pose, joints in a straight line"),
        CommandRow("move_cr", "x y z qx qy qz qw", "", "move the tip by a shift and a turn about itself"),
        CommandRow("jaw/servo_jp", "position", "", "follow this jaw angle now",
                   types=("PSM",)),
        CommandRow("jaw/move_jp", "position", "", "move the jaw to this angle",
                   types=("PSM",)),
        CommandRow("jaw/servo_jf", "effort", "", "apply this jaw effort; from position control the arm goes limp",
                   types=("PSM",)),
        CommandRow("hold", "", "", "stay at the present setpoint", stops=("*",)),
        CommandRow("free", "", "", "zero efforts; gravity compensation stays"),
        CommandRow("trajectory_j/set_ratio", "ratio", "", "speed and acceleration of moves, above 0 up to 1",
                   moves=False),
        CommandRow("trajectory_j/set_ratio_v", "ratio", "", "speed of moves, above 0 up to 1", moves=False),
        CommandRow("trajectory_j/set_ratio_a", "ratio", "", "acceleration of moves, above 0 up to 1", moves=False),
        CommandRow("set_base_frame", "x y z qx qy qz qw", "reference frame",
                   "pose of the arm's base; no values: unknown"),
        CommandRow("use_gravity_compensation", "on", "", "bear the arm's own weight", moves=False),
        CommandRow("forward_kinematics", "position, up to {n}", "", "pose of the tip, or after so many joints, there",
                   moves=False),
        CommandRow("local/forward_kinematics", "position, up to {n}", "", "the same in the arm's base", moves=False),
        CommandRow("inverse_kinematics", "seed {n}, x y z qx qy qz qw", "", "joints for a pose in the arm's base",
                   moves=False),
        CommandRow("actuator_to_joint_position", "position of every actuator", "", "joint positions", moves=False),
        CommandRow("crtk_version", "", "", "version of the commands' meaning", moves=False),
        CommandRow("set_endoscope_type", "", "endoscope", "say which endoscope an ECM carries", moves=False,
                   types=("ECM",)),
        CommandRow("lock_orientation", "qx qy qz qw, or none: as it is", "",
                   "in Cartesian effort mode: hold the orientation of a master's tip, the place stays free",
                   zero="frees",
                   types=("MTM",)),
        CommandRow("unlock_orientation", "", "", "let go of the orientation", zero="frees",
                   types=("MTM",)),
        CommandRow("set_tool_type", "", "NAME:MODEL", "say which instrument is on, when asked",
                   types=("PSM",)),
        CommandRow("emulate_adapter_present", "on", "", "act as if a sterile adapter were on; 0: its switch counts",
                   types=("PSM",)),
        CommandRow("emulate_tool_present", "on", "", "act as if an instrument were on; 0: its switch counts",
                   types=("PSM",)),
    ),
    "suj": (
        CommandRow("state_command", "", "enable|disable|home|unhome", "change the operating state", stops=("disable",)),
        CommandRow("servo_jp", "position {n}", "setup arm", "be here from now on; KINEMATIC ones only"),
        CommandRow("move_jp", "position {n}", "setup arm", "the same: nothing is there that would take time"),
        CommandRow("local/servo_cp", "x y z qx qy qz qw", "setup arm", "be here in the cart; fixed ones only"),
        CommandRow("set_reference_arm", "", "setup arm", "give base frames in the tip of the arm on this one"),
        CommandRow("clutch", "on", "setup arm", "let its brakes go, as its button does, for a minute at most",
                   zero="stops"),
        CommandRow("set_lift_velocity", "velocity", "", "move the lift, -1 down to 1 up, for a second at most; 0: stop",
                   zero="stops"),
    ),
    "teleop": (
        CommandRow("state_command", "", "enable|align_MTM|disable", "change the desired state", stops=("disable",)),
        CommandRow("set_scale", "scale", "", "slave's motion for one of the master's, above 0", moves=False),
        CommandRow("lock_rotation", "on", "", "the slave's orientation stays as it is"),
        CommandRow("lock_translation", "on", "", "the slave's position stays as it is"),
        CommandRow("set_align_MTM", "on", "", "turn the master as the slave is before following"),
        CommandRow("clutch", "0 released, 1 pressed, 2 clicked", "", "the console's clutch", level=True),
        CommandRow("following/mtm/body/servo_cf", "fx fy fz tx ty tz", "",
                   "push the master so while following, for arm.effort_timeout_s"),
    ),
    "console": (
        CommandRow("teleop_enable", "on", "", "let the selected teleoperations run, or none", zero="stops"),
        CommandRow("select_teleop", "", "teleop", "select a teleoperation; those that share an arm with it are not"),
        CommandRow("unselect_teleop", "", "teleop", "unselect a teleoperation", stops=("*",)),
        CommandRow("set_scale", "scale", "", "scale of all its teleoperations, above 0", moves=False),
        CommandRow("emulate_operator_present", "0 released, 1 pressed", "", "as if the operator came or went"),
        CommandRow("emulate_clutch", "0 released, 1 pressed, 2 clicked", "", "as if the clutch were used"),
        CommandRow("emulate_camera", "0 released, 1 pressed, 2 clicked", "", "as if the camera pedal were used"),
    ),
    "focus": (
        CommandRow("lock", "on", "", "stop, and let nothing move the lens; 0: let it", moves=False),
        CommandRow("focus_in", "on", "", "move the lens in, for 10 s at most; 0: stop", moves=False, zero="stops"),
        CommandRow("focus_out", "on", "", "move the lens out, for 10 s at most; 0: stop", moves=False,
                   zero="stops"),
    ),
    "system": (
        CommandRow("power_off", "", "", "stop teleoperation of all consoles and disable all arms", stops=("*",)),
        CommandRow("power_on", "", "", "disable arms in FAULT, then enable all; done when all are"),
        CommandRow("home", "", "", "enable arms that are not, then home all; done when all are"),
        CommandRow("set_volume", "volume", "", "0 to 1", moves=False),
        CommandRow("beep", "s, Hz, volume: 1 to 3 of them", "", "make a beep", moves=False),
        CommandRow("string_to_speech", "", "text", "say it", moves=False),
    ),
    "recorder": (
        CommandRow("choose", "", "topic, or instance", "take this into the next recording that the same client begins",
                   moves=False),
        CommandRow("record", "s, 1: end with its client, or none", "name",
                   "record what was chosen, or all arms and io; done when it has ended",
                   moves=False),
        CommandRow("stop", "", "name or none", "end the recording", moves=False),
        CommandRow("keep", "", "why", "keep what the black box and all rings have, as after a fault", moves=False),
    ),
    "boards": (
        CommandRow("press", "on", "input name", "press or release a button or switch", moves=False),
        CommandRow("insert_instrument", "", "arm NAME:MODEL", "put an instrument on", moves=False),
        CommandRow("remove_instrument", "", "arm", "take the instrument off", moves=False),
        CommandRow("apply_effort", "effort {n}", "robot", "external effort on the joints of a robot, until changed"),
        CommandRow("set_position", "position {n}", "robot, SUJ/setup arm",
                   "put actuators somewhere, at rest; a setup arm must be let go"),
        CommandRow("pull_tip", "x y z qx qy qz qw, N/m N·m/rad, N·s/m N·m·s/rad, N N·m or fewer", "robot",
                   "pull a tip to a pose in its base frame; then stiffness, damping, limits"),
        CommandRow("release_tip", "", "robot", "let go of a tip", stops=("*",)),
        CommandRow("emergency_stop", "on", "bus or none for all", "press or release the emergency stop", moves=False),
        CommandRow("power_loss", "on", "robot", "take the motor supply away", moves=False),
        CommandRow("amp_fault", "axis on", "robot", "make an amplifier fail", moves=False),
        CommandRow("encoder_jump", "axis counts", "robot", "make an encoder jump", moves=False),
        CommandRow("current_error", "axis A", "robot", "measure too much current, 0: mend", moves=False),
        CommandRow("pot_drift", "axis V/s, V or none", "robot", "let a potentiometer drift (from an error), 0 0: mend",
                   moves=False),
        CommandRow("pot_dead", "axis on", "robot", "let a potentiometer show 0 V, as with a loose cable", moves=False),
        CommandRow("encoder_scale", "axis factor", "robot", "let an encoder count so much too much, 1: mend",
                   moves=False),
        CommandRow("swap_motors", "axis axis", "robot", "exchange the plugs of two motors; again: back", moves=False),
        CommandRow("jam", "axis on", "robot", "an axis is stuck, or its brake does not let go", moves=False),
        CommandRow("unplug_board", "board", "bus or none", "take a board's power and cables away", moves=False),
        CommandRow("plug_board", "board", "bus or none", "bring a board back, as after power-up", moves=False),
        CommandRow("bus_reset", "", "bus or none for all", "another bus generation", moves=False),
        CommandRow("drop_block", "board count", "bus or none", "leave a board out of the next hub reads", moves=False),
        CommandRow("spoil_sequence", "board count", "bus or none", "wrong sequence numbers in the next hub reads",
                   moves=False),
        CommandRow("temperature", "board °C, °C or none", "bus or none", "heat the amplifiers of a board", moves=False),
        CommandRow("lose_replies", "count", "bus or none for all", "leave the next replies out", moves=False),
        CommandRow("delay_replies", "count s", "bus or none for all", "send the next replies late", moves=False),
        CommandRow("duplicate_replies", "count", "bus or none for all", "send the next replies twice", moves=False),
        CommandRow("drop_replies", "count", "bus or none for all", "answer the next reads as dropped (8 bytes)",
                   moves=False),
        CommandRow("corrupt_tl", "count", "bus or none for all", "give the next replies a wrong tl", moves=False),
        CommandRow("reply_rate", "rate, s of late ones",
                   "lost|late|duplicated|dropped|mislabelled, bus or none for all",
                   "spoil this share of replies until changed", moves=False),
        CommandRow("packet_loss", "rate", "bus or none for all", "lose this share of all datagrams until changed",
                   moves=False),
        CommandRow("clear_packet_faults", "", "", "end all faults of replies and datagrams", moves=False),
    ),
    "supervisor": (
        CommandRow("stop", "", "instance or nothing", "stop an instance; without its name, the whole system",
                   stops=("*",)),
        CommandRow("start", "", "instance", "start an instance; done when it runs"),
        CommandRow("restart", "", "instance", "stop an instance and start it again; done when it runs"),
    ),
}

COMMANDS["third_party"] = COMMANDS["arm"]  # a program refuses what it does not carry out
