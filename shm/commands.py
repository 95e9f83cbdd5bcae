"""THE TABLE of commands to running processes: one row per command, per kind of process.

shm/mailbox/command_row.py explains the columns. A command is sent as its index in its kind's table, with up to 64
numbers and a short text. Replies arrive on the client's reply ring.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from trocar.shm.mailbox.command_row import (
    ANY,
    EVERYTHING,
    FREE,
    ITSELF,
    JOINTS,
    MOTION,
    POWER,
    READ,
    RELAX,
    RELEASE,
    SETTING,
    SOME,
    ZERO,
    Argument,
    CommandRow,
    Numbers,
    Ros,
)

ENDINGS: Final = ("refused", "done", "failed")
"""Final outcomes: no other outcome follows."""


def became(outcome: str) -> str:
    """An outcome as a sentence has it: "move_jp was refused", "move_jp failed"."""
    return outcome if outcome == "failed" else f"was {outcome}"



ON: Final = Argument("on", low=0.0, high=1.0, whole=True)
ROBOT: Final = "robot"
AXIS: Final = Argument("axis", low=0.0, high=255.0, whole=True)
COUNT: Final = Argument("count", low=0.0, high=1e6, whole=True)
DELAY: Final = Argument("delay", "s", low=0.0, high=60.0)
BOARD: Final = Argument("board", low=0.0, high=15.0, whole=True)
RATE: Final = Argument("rate", low=0.0, high=1.0)
POSITION: Final = Argument("position", "rad|m", JOINTS)
INCREMENT: Final = Argument("increment", "rad|m", JOINTS)
VELOCITY: Final = Argument("velocity", "rad/s|m/s", JOINTS)
EFFORT: Final = Argument("effort", "N·m|N", JOINTS)
POSE: Final = Argument("x y z qx qy qz qw", "m", 7)
TWIST: Final = Argument("twist", "m/s, rad/s", 6, optional=True)
WRENCH: Final = Argument("fx fy fz tx ty tz", "N, N·m", 6)
FOR_A_WHILE: Final = (Argument("time it lasts", "s", optional=True),
                      Argument("axes: 0 tip, 1 reference frame", low=0.0, high=1.0, optional=True, whole=True))
RATIO: Final = Argument("ratio", low=0.0, high=1.0, above=True)
SCALE: Final = Argument("scale", low=0.0, high=1.0, above=True)
PEDAL: Final = Argument("button (0 released, 1 pressed, 2 clicked)", low=0.0, high=2.0, whole=True)

FRAME: Final = "frame: the arm's base, or by default its reference frame"

GRIP: Final = tuple(Argument(name, unit, 2, optional=True) for name, unit in (
    ("stiffness", "N/m, N·m/rad"), ("damping", "N·s/m, N·m·s/rad"), ("limits", "N, N·m")))
PSM, MTM, ECM = ("PSM",), ("MTM",), ("ECM",)
BOOL, EMPTY, TEXT, STATE, BUTTON = Ros("bool"), Ros("empty"), Ros("text"), Ros("state"), Ros("button")
BUS, OF_BUS = "bus or none for all", "bus or none"


def part(message: str, name: str, kind: str = "") -> Ros:
    """A ROS topic for each robot or setup arm."""
    return Ros(message, (f"{{part}}/{name}",), kind)


COMMANDS: dict[str, tuple[CommandRow, ...]] = {
    "io": (
        CommandRow("power_on", POWER, "close the safety relay, switch motor power on, enable the amplifiers",
                   text=ROBOT, ros=part("empty", "power_on")),
        CommandRow("power_off", POWER, "disable the amplifiers, switch motor power off",
                   (replace(ON, name="open_relays", optional=True),), ROBOT, stops=(ANY,),
                   ros=part("empty", "power_off")),
        CommandRow("bias_encoders", RELAX, "set encoders from potentiometers; samples < 0: unless all are set already",
                   (Argument("samples", whole=True), Argument("axes to leave out", size=SOME, low=0.0, whole=True)),
                   ROBOT),
        CommandRow("set_encoder", RELAX, "set the encoder of an axis to its known position",
                   (AXIS, Argument("position", "rad|m")), ROBOT),
        CommandRow("pid_enable", POWER, "joint controller on, or off with brakes engaged", (ON,), ROBOT, stops=(ZERO,),
                   ros=part("bool", "enable", "pid")),
        CommandRow("servo_zero", POWER, "zero efforts, joint controller off, brakes hold", text=ROBOT, stops=(ANY,)),
        CommandRow("enforce_limits", RELAX, "clip setpoints to the position limits", (ON,), ROBOT,
                   effect_of_one=SETTING),
        CommandRow("tracking_check", RELAX, "trip on too large a tracking error", (ON,), ROBOT, effect_of_one=SETTING,
                   ros=part("bool", "tracking_check")),
        CommandRow("pot_check", RELAX, "compare potentiometers with encoders", (ON,), ROBOT, effect_of_one=SETTING,
                   ros=part("bool", "pot_check")),
        CommandRow("use_setpoint_v", SETTING, "use the velocity feed of setpoints", (ON,), ROBOT,
                   ros=part("bool", "use_setpoint_v", "pid")),
        CommandRow("set_gains", RELAX, "change gains of the robot's joint controller from this cycle on",
                   (Argument("axis, -1: all", low=-1.0, whole=True), Argument("a value for each key", size=SOME)),
                   "robot, keys of the PID file, @who or nothing"),
        CommandRow("brake_release", RELEASE, "release the brakes; the joint controller must be on", text=ROBOT,
                   ros=part("empty", "brake_release")),
        CommandRow("brake_engage", SETTING, "engage the brakes", text=ROBOT, ros=part("empty", "brake_engage")),
        CommandRow("set_output", SETTING, "set a digital output high (1) or low (0); a one-shot resets itself", (ON,),
                   "output name"),
        CommandRow("set_pwm", MOTION, "duty cycle of a digital output",
                   (Argument("duty", low=0.0, high=1.0),), "output name", stops=(ZERO,)),
        CommandRow("lift", MOTION, "move the lift of a patient cart (1: up, -1: down) until 30 ms after the last such "
                   "command; 0: stop", (Argument("velocity", low=-1.0, high=1.0),), ROBOT,
                   effect_of_zero=SETTING, stream="lift"),
        CommandRow("setup_brake", RELEASE, "release the brakes of the setup arm under an Si arm until 30 ms after the "
                   "last such command; 0: engage them", (ON,), ROBOT, effect_of_zero=SETTING, stream="brake"),
        CommandRow("multiplexer", SETTING, "select the next (1) or the first (0) channel of a cart's potentiometers",
                   (ON,), ROBOT),
        CommandRow("trigger_read", READ, "read the memory of the instrument; the reply has its NAME:MODEL[VERSION]",
                   text="instrument reader"),
        CommandRow("clear_fault", SETTING, "clear the latched fault", text=ROBOT),
        CommandRow("supply_on", POWER, "close the safety relay, power motors for this time; amplifiers stay off",
                   (Argument("time", "s", low=0.0, high=60.0, above=True),), ROBOT),
        CommandRow("drive_axis", POWER, "ramp the current of one motor up until it has moved by `travel`; all others "
                   "are free",
                   (AXIS, Argument("current", "A"), Argument("rise time", "s"), Argument("travel", "rad|m"),
                    replace(ON, name="release its brake")), ROBOT),
        CommandRow("brake_current", RELEASE, "give one brake a current for 0.5 s, while the motors have none",
                   (AXIS, Argument("current", "A")), ROBOT),
    ),
    "arm": (
        CommandRow("state_command", POWER, "change the operating state",
                   text="enable|disable|home|unhome|pause|resume", effect_of_words={"unhome": MOTION},
                   stops=("disable", "pause"), ros=STATE),
        CommandRow("servo_jp", MOTION, "follow these joint positions now", (POSITION, replace(VELOCITY, optional=True)),
                   stream="position", ros=Ros("joint setpoint", newest=True)),
        CommandRow("servo_jr", MOTION, "follow the setpoint plus these increments", (INCREMENT,), stream="position",
                   ros=Ros("joint positions")),
        CommandRow("servo_jv", MOTION, "go at these joint velocities until 0.1 s after the last such command",
                   (VELOCITY,), stream="position", ros=Ros("joint velocities", newest=True)),
        CommandRow("servo_jf", MOTION, "apply these efforts for arm.effort_timeout_s; zeros have no timeout", (EFFORT,),
                   effect_of_zero=FREE, stream="effort", ros=Ros("joint efforts", newest=True)),
        CommandRow("servo_cp", MOTION, "follow this tip pose now", (POSE, TWIST), text=FRAME, stream="position",
                   ros=Ros("pose", newest=True)),
        CommandRow("servo_cr", MOTION, "follow the setpoint pose, shifted and turned about its tip", (POSE,),
                   text=FRAME, stream="position", ros=Ros("pose")),
        CommandRow("servo_cs", MOTION, "follow a pose with velocity and wrench; without a pose apply the wrench",
                   (POSE, replace(TWIST, optional=False), WRENCH,
                    replace(ON, name="1 or 0 for pose, twist, wrench", size=3)),
                   text=FRAME, stream="position", ros=Ros("cartesian state", newest=True)),
        CommandRow("servo_cf", MOTION, "the same as body/servo_cf",
                   (WRENCH, *FOR_A_WHILE), text=FRAME, effect_of_zero=FREE, stream="effort"),
        CommandRow("body/servo_cf", MOTION,
                   "apply this force and torque at the tip, for arm.effort_timeout_s at most",
                   (WRENCH, *FOR_A_WHILE), text=FRAME, effect_of_zero=FREE, stream="effort",
                    ros=Ros("wrench", newest=True)),
        CommandRow("spatial/servo_cf", MOTION, "apply this force and torque at the origin of the base", (WRENCH,),
                   text=FRAME, effect_of_zero=FREE, stream="effort", ros=Ros("wrench", newest=True)),
        CommandRow("servo_ci", MOTION, "push like springs and dampers about a position and an orientation",
                   (Argument("position, axes q, orientation q, gains", size=59),), text=FRAME, stream="effort",
                   ros=Ros("impedance", newest=True)),
        CommandRow("body/set_cf_orientation_absolute", SETTING,
                   "interpret wrenches that name no axes in the axes of the reference frame", (ON,),
                   ros=BOOL),
        CommandRow("move_jp", MOTION, "move to these joint positions and stop there", (POSITION,),
                   move=True, ros=Ros("joint positions")),
        CommandRow("move_jr", MOTION, "move by these increments", (INCREMENT,), move=True, ros=Ros("joint positions")),
        CommandRow("move_cp", MOTION, "move to this tip pose, in a straight line in joint space", (POSE,), text=FRAME,
                   move=True, ros=Ros("pose")),
        CommandRow("move_cr", MOTION, "move the tip by a shift and a turn about itself", (POSE,), text=FRAME,
                   move=True, ros=Ros("pose")),
        CommandRow("jaw/servo_jp", MOTION, "follow this jaw angle now", (Argument("position", "rad"),),
                   stream="jaw", types=PSM, ros=Ros("joint positions", newest=True)),
        CommandRow("jaw/move_jp", MOTION, "move the jaw to this angle", (Argument("position", "rad"),), types=PSM,
                   move=True, ros=Ros("joint positions")),
        CommandRow("jaw/servo_jf", MOTION, "apply this jaw effort; if the arm was in position control, it goes limp",
                   (Argument("effort", "N·m"),), stream="jaw", types=PSM, ros=Ros("joint efforts", newest=True)),
        CommandRow("hold", MOTION, "end motion and hold the setpoint; if not homed: pause, and void earlier commands",
                   stops=(ANY,), ros=EMPTY),
        CommandRow("end_stream", SETTING, "hold, if the present motion was requested by the same program"),
        CommandRow("free", MOTION, "zero efforts; gravity compensation stays", ros=EMPTY),
        CommandRow("trajectory_j/set_ratio", SETTING, "speed and acceleration of moves", (RATIO,), ros=Ros("number")),
        CommandRow("trajectory_j/set_ratio_v", SETTING, "speed of moves", (RATIO,), ros=Ros("number")),
        CommandRow("trajectory_j/set_ratio_a", SETTING, "acceleration of moves", (RATIO,), ros=Ros("number")),
        CommandRow("set_base_frame", MOTION, "set the pose of the arm's base; no values: unknown",
                   (replace(POSE, optional=True),), "reference frame", ros=Ros("framed pose")),
        CommandRow("add_wall", SETTING, "keep the arm out of a shape, or in",
                   (POSE, Argument("size, margin", "m|rad", SOME, low=0.0)),
                   "NAME SHAPE and words of docs/walls.md"),
        CommandRow("remove_wall", RELAX, "remove a wall", text="its name"),
        CommandRow("use_gravity_compensation", MOTION, "compensate the arm's own weight", (ON,), effect_of_one=SETTING,
                   ros=BOOL),
        CommandRow("forward_kinematics", READ, "pose of the tip, or of the frame after as many joints as are given",
                   (replace(POSITION, size=SOME),)),
        CommandRow("local/forward_kinematics", READ, "the same in the arm's base", (replace(POSITION, size=SOME),)),
        CommandRow("inverse_kinematics", READ, "joints for a pose in the arm's base",
                   (Argument("seed {n}, x y z qx qy qz qw", size=SOME),)),
        CommandRow("actuator_to_joint_position", READ, "joint positions",
                   (Argument("position of every actuator", "rad|m", SOME),)),
        CommandRow("crtk_version", READ, "version of CRTK that defines the commands"),
        CommandRow("set_endoscope_type", SETTING, "select the endoscope that an ECM carries", text="endoscope",
                   types=ECM, ros=TEXT),
        CommandRow("lock_orientation", MOTION,
                   "in Cartesian effort mode: hold the orientation of a master's tip, its position stays free; "
                   "no values: the present one", (Argument("qx qy qz qw", size=4, optional=True),), effect_of_zero=FREE,
                   types=MTM, ros=Ros("quaternion")),
        CommandRow("unlock_orientation", MOTION, "stop holding the orientation", effect_of_zero=FREE, types=MTM,
                   ros=EMPTY),
        CommandRow("set_tool_type", MOTION, "name the attached instrument, when the arm asks for it", text="NAME:MODEL",
                   types=PSM, ros=TEXT),
        CommandRow("emulate_adapter_present", MOTION, "act as if a sterile adapter were attached; 0: use its switch",
                   (ON,), types=PSM, ros=BOOL),
        CommandRow("emulate_tool_present", MOTION, "act as if an instrument were attached; 0: use its switch", (ON,),
                   types=PSM, ros=BOOL),
    ),
    "suj": (
        CommandRow("state_command", POWER, "change the operating state", text="enable|disable|home|unhome",
                   effect_of_words={"unhome": MOTION}, stops=("disable",),
                   ros=Ros("state", ("state_command", "{part}/state_command"))),
        CommandRow("servo_jp", MOTION, "set the joint positions; KINEMATIC setup arms only", (POSITION,), "setup arm",
                   stream="position",
                   ros=part("joint positions", "servo_jp")),
        CommandRow("move_jp", MOTION, "the same as servo_jp: the joints are there at once", (POSITION,), "setup arm",
                   ros=part("joint positions", "move_jp")),
        CommandRow("local/servo_cp", MOTION, "set the pose in the cart; fixed setup arms only", (POSE,), "setup arm",
                   stream="position"),
        CommandRow("set_reference_arm", MOTION, "give base frames relative to the tip of the arm on this setup arm",
                   text="setup arm", ros=TEXT),
        CommandRow("clutch", RELEASE, "release its brakes, as its button does, for a minute at most", (ON,),
                   "setup arm", stops=(ZERO,), ended_by=ITSELF),
        CommandRow("set_lift_velocity", MOTION, "move the lift (1: up, -1: down) for a second at most; 0: stop",
                   (Argument("velocity", low=-1.0, high=1.0),), stops=(ZERO,), stream="lift",
                   ended_by=ITSELF),
    ),
    "teleop": (
        CommandRow("state_command", MOTION, "change the desired state", text="enable|align_MTM|disable",
                   stops=("disable",), causes=("arm.*",), ros=STATE),
        CommandRow("set_scale", MOTION, "ratio of the slave's motion to the master's", (SCALE,), ros=Ros("number")),
        CommandRow("lock_rotation", MOTION, "the slave's orientation stays as it is", (ON,), types=PSM, ros=BOOL),
        CommandRow("lock_translation", MOTION, "the slave's position stays as it is", (ON,), types=PSM, ros=BOOL),
        CommandRow("set_align_MTM", MOTION, "align the master with the slave before following", (ON,), types=PSM,
                   ros=BOOL),
        # A pedal's level, which holds until the next one: following requires an enable of its own.
        CommandRow("clutch", SETTING, "the console's clutch", (PEDAL,)),
        CommandRow("following/mtm/body/servo_cf", MOTION,
                   "apply this wrench to the master while following, for arm.effort_timeout_s", (WRENCH,),
                   stream="effort", types=PSM, ros=Ros("wrench", newest=True)),
    ),
    "console": (
        CommandRow("teleop_enable", MOTION, "start the selected teleoperations, or stop them", (ON,), stops=(ZERO,),
                   causes=("teleop.*",), ros=Ros("bool", ("teleop/enable",))),
        CommandRow("select_teleop", MOTION, "select a teleoperation, and unselect those that share an arm with it",
                   text="teleop", causes=("teleop.*",), ros=Ros("text", ("teleop/select",))),
        CommandRow("unselect_teleop", MOTION, "unselect a teleoperation", text="teleop", stops=(ANY,),
                   ros=Ros("text", ("teleop/unselect",))),
        CommandRow("set_scale", MOTION, "scale of all its teleoperations", (SCALE,), causes=("teleop.set_scale",),
                   ros=Ros("number", ("teleop/set_scale",))),
        CommandRow("emulate_operator_present", MOTION,
                   "act as if the operator arrived (until the sending program ends) or left; stay: also after it ends, "
                   "if the console has no pedal or head sensor for the operator",
                   (replace(PEDAL, name="button (0 released, 1 pressed)", high=1.0),), "stay or nothing",
                   effect_of_zero=SETTING, ended_by=ITSELF, ros=BUTTON),
        CommandRow("emulate_clutch", MOTION, "as if the clutch were used", (PEDAL,), effect_of_one=SETTING,
                   causes=("teleop.clutch",), ros=BUTTON),
        CommandRow("emulate_camera", MOTION, "as if the camera pedal were used", (PEDAL,), causes=("teleop.*",),
                   ros=BUTTON),
    ),
    "focus": (
        CommandRow("lock", SETTING, "stop and lock the lens; 0: unlock it", (ON,), ros=BOOL),
        CommandRow("focus_in", SETTING, "move the lens in, for 10 s at most; 0: stop", (ON,), stops=(ZERO,),
                   stream="lens", ended_by=ITSELF, ros=BOOL),
        CommandRow("focus_out", SETTING, "move the lens out, for 10 s at most; 0: stop", (ON,), stops=(ZERO,),
                   stream="lens", ended_by=ITSELF, ros=BOOL),
    ),
    "system": (
        CommandRow("power_off", POWER, "stop teleoperation of all consoles and disable all arms", stops=(ANY,),
                   ros=EMPTY),
        CommandRow("power_on", POWER, "disable arms in FAULT, then enable all; done when all are enabled",
                   causes=("arm.state_command", "suj.state_command"), ros=EMPTY),
        CommandRow("home", POWER, "enable arms that are not enabled, then home all; done when all are homed",
                   causes=("arm.state_command", "suj.state_command"), ros=EMPTY),
        CommandRow("hold", MOTION, "stop teleoperation of all consoles, end power_on and home, send hold to all arms",
                   stops=(ANY,)),
        CommandRow("set_volume", SETTING, "volume of all sounds, 0 to 1", (Argument("volume"),), ros=Ros("number")),
        CommandRow("beep", SETTING, "make a beep", (Argument("duration", "s"),
                                                    Argument("frequency", "Hz", optional=True),
                                                    Argument("volume", optional=True)),
                   ros=Ros("numbers")),
        CommandRow("string_to_speech", SETTING, "speak a text", text="text", ros=TEXT),
        CommandRow("show_pose", SETTING, "show these joint positions of an arm in 3D until the sending program ends; "
                   "no arm: hide them", (Argument("position", "rad|m", SOME, low=-10.0, high=10.0),),
                   "arm, SUJ/setup arm or nothing"),
    ),
    "recorder": (
        CommandRow("choose", SETTING, "add this to the next recording of the same client", text="topic, or instance"),
        CommandRow("record", SETTING, "record what was chosen, or all arms and io; done when it has ended",
                   (Argument("time", "s", optional=True), replace(ON, name="end with its client", optional=True)),
                   "name"),
        CommandRow("stop", SETTING, "end the recording", text="name or none"),
        CommandRow("keep", SETTING, "save the black box and all rings, as after a fault", text="why"),
    ),
    "boards": (
        CommandRow("press", SETTING, "press or release a button or switch", (ON,), "input name"),
        CommandRow("insert_instrument", SETTING, "insert an instrument", text="arm NAME:MODEL"),
        CommandRow("remove_instrument", SETTING, "remove the instrument", text="arm"),
        CommandRow("apply_effort", MOTION, "external effort on the joints of a robot, until changed", (EFFORT,), ROBOT),
        CommandRow("set_position", MOTION, "set actuator positions, at rest; a setup arm must be released",
                   (POSITION,), "robot, SUJ/setup arm"),
        CommandRow("move_by_hand", MOTION, "set_position, but engaged brakes do not move", (POSITION,), ROBOT),
        CommandRow("support", MOTION, "support the weight of a robot by hand, or release it", (ON,), ROBOT),
        CommandRow("pull_tip", MOTION, "pull a tip to a pose in its base frame, with this stiffness, damping, limits",
                   (POSE, *GRIP), ROBOT, stream="pull", ended_by="release_tip"),
        CommandRow("release_tip", MOTION, "release a tip", text=ROBOT, stops=(ANY,)),
        CommandRow("emergency_stop", SETTING, "press or release the emergency stop", (ON,), BUS),
        CommandRow("power_loss", SETTING, "make the motor supply fail (1), or restore it (0)", (ON,), ROBOT),
        CommandRow("amp_fault", SETTING, "make an amplifier fail", (AXIS, ON), ROBOT),
        CommandRow("encoder_jump", SETTING, "make an encoder jump",
                   (AXIS, Argument("counts", low=-8388608.0, high=8388608.0, whole=True)), ROBOT),
        CommandRow("current_error", SETTING, "add an offset to the measured current, 0: repaired",
                   (AXIS, Argument("current", "A")), ROBOT),
        CommandRow("pot_drift", SETTING, "make a potentiometer drift, starting at an error if given; 0 0: repaired",
                   (AXIS, Argument("rate", "V/s"), Argument("error", "V", optional=True)), ROBOT),
        CommandRow("pot_dead", SETTING, "make a potentiometer show 0 V, as with a loose cable", (AXIS, ON), ROBOT),
        CommandRow("encoder_scale", SETTING, "scale the counts of an encoder, 1: repaired",
                   (AXIS, Argument("factor")), ROBOT),
        CommandRow("swap_motors", SETTING, "swap the plugs of two motors; again to undo",
                   (AXIS, replace(AXIS, name="axis")), ROBOT),
        CommandRow("jam", SETTING, "block an axis, like a brake that does not release", (AXIS, ON), ROBOT),
        CommandRow("unplug_board", SETTING, "unplug a board's power and cables", (BOARD,), OF_BUS),
        CommandRow("plug_board", SETTING, "plug a board in again, as after power-up", (BOARD,), OF_BUS),
        CommandRow("bus_reset", SETTING, "start another bus generation", text=BUS),
        CommandRow("drop_block", SETTING, "leave a board out of the next hub reads", (BOARD, COUNT), OF_BUS),
        CommandRow("spoil_sequence", SETTING, "spoil sequence numbers in the next hub reads", (BOARD, COUNT), OF_BUS),
        CommandRow("temperature", SETTING, "heat the amplifiers of a board",
                   (BOARD, Argument("first", "°C"), Argument("second", "°C", optional=True)), OF_BUS),
        CommandRow("lose_replies", SETTING, "lose the next replies; the requests are carried out", (COUNT,), BUS),
        CommandRow("delay_replies", SETTING, "send the next replies late", (COUNT, DELAY), BUS),
        CommandRow("duplicate_replies", SETTING, "send the next replies twice", (COUNT,), BUS),
        CommandRow("drop_replies", SETTING, "answer the next reads as dropped (8 bytes)", (COUNT,), BUS),
        CommandRow("corrupt_tl", SETTING, "give the next replies a wrong transaction label (tl)", (COUNT,), BUS),
        CommandRow("reply_rate", SETTING, "spoil this share of replies until changed",
                   (RATE, replace(DELAY, name="delay of late ones", optional=True)),
                   f"lost|late|duplicated|dropped|mislabelled, {BUS}"),
        CommandRow("packet_loss", SETTING, "lose this share of all datagrams until changed", (RATE,), BUS),
        CommandRow("clear_packet_faults", SETTING, "end all faults of replies and datagrams"),
    ),
    "supervisor": (
        CommandRow("stop", POWER, "stop an instance; without its name, the whole system", text="instance or nothing",
                   stops=(ANY,)),
        CommandRow("start", POWER, "start an instance; done when it runs", text="instance"),
        CommandRow("restart", POWER, "stop an instance and start it again; done when it runs", text="instance"),
    ),
}

COMMANDS["third_party"] = COMMANDS["arm"]  # a program refuses commands that it does not handle


def caused(row: CommandRow) -> list[CommandRow]:
    """The row and all commands that it triggers, directly or indirectly: the transitive closure over `causes`."""
    found, waiting = [row], [row]
    while waiting:
        for other in _named(waiting.pop().causes):
            if not any(other is each for each in found):
                found.append(other)
                waiting.append(other)
    return found


def _named(causes: tuple[str, ...]) -> Iterator[CommandRow]:
    for cause in causes:
        kind, _, name = cause.partition(".")
        for rows in COMMANDS.values() if cause == EVERYTHING else (COMMANDS[kind],):
            yield from (row for row in rows if name in ("*", row.name))


POWERS: Final = (RELAX, RELEASE, POWER)
"""Effects that a bridge's client may cause only if the system file sets `may_power`."""


def may_power(row: CommandRow, text: str, values: Numbers) -> bool:
    """Whether it can power, home, release a brake or change protection, directly or through commands it causes."""
    effect = row.effect_for(text, values)
    if effect < RELAX:
        return False
    return effect in POWERS or any(each.effect in POWERS for each in caused(row)[1:])


def can_stop(name: str, text: str, values: Numbers) -> bool:
    """Whether a command of this name stops something, in any kind of process."""
    return any(row.is_stop(text, values) for rows in COMMANDS.values() for row in rows if row.name == name)
