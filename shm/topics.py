"""THE TABLE of shared data: every shared record's layout, its unit and meaning, and the CRTK views on it.

A row is a template for a kind of process. Sizes in brackets may be names (`axes`, `drives`, `robots`, `inputs`,
`outputs`, `readers`, `boards`, `setups`): they are filled in when an instance is created, and the filled-in schema is
stored in the segment's header. Every record begins with `sequence` and `stamp_ns` (monotonic); they are part of the
ring and are not listed here.
"""

from __future__ import annotations

from dataclasses import replace

from trocar.shm.mailbox.messages import AUDIT as AUDIT
from trocar.shm.mailbox.messages import COMMAND as COMMAND
from trocar.shm.mailbox.messages import EVENTS as EVENTS
from trocar.shm.mailbox.messages import REPLY as REPLY
from trocar.shm.memory.rows import Field as Field
from trocar.shm.memory.rows import Topic as Topic
from trocar.shm.memory.rows import View as View
from trocar.shm.operator_topics import CONSOLE_STATE as CONSOLE_STATE
from trocar.shm.operator_topics import FOCUS_STATE as FOCUS_STATE
from trocar.shm.operator_topics import GUI_STATE as GUI_STATE
from trocar.shm.operator_topics import RECORDER_STATE as RECORDER_STATE
from trocar.shm.operator_topics import SYSTEM_STATE as SYSTEM_STATE
from trocar.shm.operator_topics import TELEOP_STATE as TELEOP_STATE
from trocar.shm.operator_topics import THIRD_PARTY_STATE as THIRD_PARTY_STATE

JOINTS = 8  # room in an arm's record; longer chains do not exist on a da Vinci

IO_STATE = Topic("state", writer="io", rate_hz=1500, fields=(
    Field("valid", "?", "", "this cycle's sample of every board arrived; false: values are the last good ones"),
    Field("age_ns", "<i8", "ns", "age of the last good sample of every board when this was written"),
    Field("cycle", "<u8", "", "I/O cycles since start"),
    Field("read_ns", "<i8", "ns", "monotonic time when the read request went out"),
    Field("recv_ns", "<i8", "ns", "monotonic time when the last reply had been received"),
    Field("write_ns", "<i8", "ns", "monotonic time when the last write had been sent"),
    Field("bad_reads", "<u8", "", "failed reads since start"),
    # axes: all actuators of all robots, in the order of the document; `robots` of the header's info has the cuts
    # drives: these, then the brakes of all robots
    Field("position", "(axes,)<f8", "rad|m", "measured actuator position from the encoders"),
    Field("velocity", "(axes,)<f8", "rad/s|m/s", "measured actuator velocity, from the source set in the IO file"),
    Field("effort", "(axes,)<f8", "N·m|N", "effort from the measured motor current"),
    Field("setpoint_position", "(axes,)<f8", "rad|m", "position the joint controller follows"),
    Field("setpoint_velocity", "(axes,)<f8", "rad/s|m/s", "velocity feed of the joint controller"),
    Field("setpoint_effort", "(axes,)<f8", "N·m|N", "effort that the joint controller requests, after all limits"),
    Field("position_error", "(axes,)<f8", "rad|m", "setpoint minus measured, after the dead-band"),
    Field("disturbance", "(axes,)<f8", "N·m|N", "what the joint controller's observer adds; 0 where it has none"),
    Field("firmware_velocity", "(axes,)<f8", "rad/s|m/s", "from edge times, extrapolated to the sample's time"),
    Field("software_velocity", "(axes,)<f8", "rad/s|m/s", "from differences of the encoder counts",
          "software_velocity"),
    Field("acceleration", "(axes,)<f8", "rad/s²|m/s²", "from the edge times that the boards measure", "acceleration"),
    Field("pot_position", "(axes,)<f8", "rad|m", "actuator position from the potentiometers"),
    Field("pot_voltage", "(axes,)<f8", "V", "potentiometer voltage; 0: digital"),
    Field("pot_bits", "(axes,)<u2", "", "raw potentiometer reading"),
    Field("current", "(drives,)<f8", "A", "measured motor current"),
    Field("current_request", "(drives,)<f8", "A", "motor current sent to the board, after clamping"),
    Field("temperature", "(drives,)<f8", "°C", "amplifier temperature"),
    Field("encoder_bits", "(axes,)<i4", "counts", "encoder counter, 0 at mid-range"),
    Field("amp_enabled", "(drives,)?", "", "amplifier enable requested"),
    Field("amp_on", "(drives,)?", "", "amplifier reports that it is on"),
    Field("effort_mode", "(axes,)?", "", "efforts are passed through, positions not followed"),
    Field("at_limit", "(axes,)?", "", "the setpoint was clipped to a position limit"),
    Field("encoder_set", "(axes,)?", "", "the encoder has been set since its board got power"),
    # robots
    Field("power_requested", "(robots,)?", "", "power is requested"),
    Field("powered", "(robots,)?", "", "supply, relay and watchdog of all its boards are good"),
    Field("amps_on", "(robots,)?", "", "every amplifier of the robot is on"),
    Field("watchdog", "(robots,)?", "", "a board's watchdog has cut the amplifiers"),
    Field("power_fault", "(robots,)?", "", "a board reports a motor supply fault"),
    Field("relay", "(robots,)?", "", "safety relay closed, as read back"),
    Field("biased", "(robots,)?", "", "a bias set all encoders but those left out, or all were found set"),
    Field("biasing", "(robots,)?", "", "encoders are being set: potentiometers are sampled, or encoders written"),
    Field("bias_generation", "(robots,)<u4", "", "counts settings of encoders; a homing is valid for one count"),
    Field("brakes_released", "(robots,)?", "", "the brakes are released; false without brakes"),
    Field("pot_check", "(robots,)?", "", "potentiometers are compared with the encoders"),
    Field("pid_enabled", "(robots,)?", "", "the joint controller drives the motors"),
    Field("pid_generation", "(robots,)<u4", "", "counts enables of the joint controller"),
    Field("limits_enforced", "(robots,)?", "", "setpoints are clipped to the position limits"),
    Field("tracking_check", "(robots,)?", "", "too large a tracking error trips the joint controller"),
    Field("use_setpoint_velocity", "(robots,)?", "", "velocity feed of setpoints is used"),
    Field("holding", "(robots,)?", "", "no fresh setpoint from the arm: holding the last one"),
    Field("setpoint_age_ns", "(robots,)<i8", "ns", "age of the arm's newest setpoint, -1: there was none"),
    Field("fault", "(robots,)<u2", "", "latched fault of the robot (0: none), a number of the fault table"),
    Field("desired_generation", "(robots,)<u4", "", "newest generation of desired states that io has read"),
    Field("desired_void", "(robots,)?", "", "that one is void: a fault or an operator's command came after it"),
    Field("desired_refused", "(robots,)S96", "", "why the desired state is not reached; empty: it is, or will be"),
    Field("calibration_mode", "?", "", "potentiometers and currents are being calibrated: some checks are off"),
    Field("simulated", "(robots,)?", "", "KINEMATIC: there is no robot, positions are setpoints; the rest is NaN"),
    Field("robot_valid", "(robots,)?", "", "this cycle's sample of all its boards arrived: no board is missing"),
    Field("sample_age_ns", "(robots,)<i8", "ns", "age of the last good sample of all its boards"),
    Field("board_period", "(robots,)<f8", "s", "time between the last two samples by the board's own clock"),
    # inputs, outputs
    Field("input", "(inputs,)?", "", "debounced digital inputs, true: pressed"),
    Field("output", "(outputs,)?", "", "digital outputs, true: the pin is high"),
), views=(
    View("measured_js", "js", (("position", "position"), ("velocity", "velocity"), ("effort", "effort")), "robot"),
    View("setpoint_js", "js", (("position", "setpoint_position"), ("velocity", "setpoint_velocity"),
                               ("effort", "setpoint_effort")), "robot"),
    View("error_state/measured_js", "js", (("position", "position_error"), ("effort", "disturbance")), "robot"),
    View("firmware/measured_js", "js", (("position", "position"), ("velocity", "firmware_velocity")), "robot"),
    View("software/measured_js", "js", (("position", "position"), ("velocity", "software_velocity")), "robot"),
    View("pot/measured_js", "js", (("position", "pot_position"),), "robot"),
    View("raw_pot/measured_js", "js", (("position", "pot_bits"),), "robot"),
    View("measured_current", "js", (("effort", "current"),), "robot"),
    View("servo_current", "js", (("effort", "current_request"),), "robot"),
))

# Changed by commands only: written at start and after every change, so the newest record is the current state.
IO_GAINS = Topic("gains", writer="io", depth=32, fields=(
    Field("changes", "<u4", "", "changes by command since io started; 0: all gains are those of the PID files"),
    # axes as in the state record; all 0 for a robot without a joint controller
    Field("p_gain", "(axes,)<f8", "N·m/rad|N/m", "proportional gain"),
    Field("d_gain", "(axes,)<f8", "N·m·s/rad|N·s/m", "derivative gain"),
    Field("i_gain", "(axes,)<f8", "N·m/rad|N/m", "integral gain, each cycle"),
    Field("p_deadband", "(axes,)<f8", "rad|m", "position error without effect"),
    Field("p_deadband_outer", "(axes,)<f8", "rad|m", "beyond this error, only `p_deadband` is subtracted from it"),
    Field("i_forget_rate", "(axes,)<f8", "", "factor on the integral, each cycle"),
    Field("i_limit", "(axes,)<f8", "rad|m", "largest integral"),
    Field("offset", "(axes,)<f8", "N·m|N", "effort added when positions are followed"),
    Field("pid_max_output", "(axes,)<f8", "N·m|N", "largest effort of the joint controller; negative: no limit"),
    Field("p_measured_setpoint_tolerance", "(axes,)<f8", "rad|m", "tracking error that trips the joint controller"),
    Field("v_low_pass_cutoff", "(axes,)<f8", "", "weight of the newest velocity feed"),
    Field("use_disturbance_observer", "(axes,)?", "", "the observed disturbance is compensated"),
    Field("nominal_mass", "(axes,)<f8", "kg·m²|kg", "inertia that the observer assumes"),
    Field("disturbance_cutoff", "(axes,)<f8", "1/s", "how fast the observer is"),
))

IO_INSTRUMENTS = Topic("instruments", writer="io", depth=64, fields=(
    # readers: entries of `dallas_chips`, in the order of the files
    Field("reader", "(readers,)S40", "", "name of the entry that reads an instrument's memory"),
    Field("status", "(readers,)S8", "", "READING, READ, ABSENT or ERROR; empty: never requested"),
    Field("tool", "(readers,)S48", "", "NAME:MODEL[VERSION], empty unless READ"),
    Field("name", "(readers,)S28", "", "name as the memory has it"),
    Field("model", "(readers,)<u4", "", "model number"),
    Field("version", "(readers,)u1", "", "version"),
    Field("since_ns", "(readers,)<i8", "ns", "monotonic time of the last change of `status`"),
))

SETPOINT = Topic("setpoint", writer="arm", rate_hz=1500, fields=(
    Field("mode", "u1", "", "0 alive, no request; 1 drive the actuators as the other fields say"),
    Field("has_velocity", "?", "", "the velocities are used"),
    Field("count", "u1", "", "actuators in use"),
    Field("in_effort", "(8,)?", "", "per actuator: the effort is applied; false: the position is followed"),
    Field("bias_generation", "<u4", "", "bias generation these positions belong to"),
    Field("pid_generation", "<u4", "", "`pid_generation` of io that these positions are meant for"),
    # the arm's desired state of io, see procs/tables/desired_state.py: 0 none, 1 off, 2 on
    Field("desired_generation", "<u4", "", "counts changes of the desired state; 0: there is none"),
    Field("desired_fault", "u1", "", "1: clear the latched fault"),
    Field("desired_power", "u1", "", "power: 0 no request, 1 off, 2 on; also for the six fields below"),
    Field("desired_limits", "u1", "", "clip setpoints to the position limits"),
    Field("desired_tracking", "u1", "", "trip on too large a tracking error"),
    Field("desired_velocity", "u1", "", "use the velocity feed"),
    Field("desired_pots", "u1", "", "compare potentiometers with encoders"),
    Field("desired_pid", "u1", "", "joint controller"),
    Field("desired_brakes", "u1", "", "brakes released"),
    Field("desired_origin", "<u8", "", "the operator's command that caused it, 0: none"),
    Field("desired_since", "<u8", "", "fault generation of the system at that command"),
    Field("desired_program", "S16", "", "program that sent that command"),
    Field("position", "(8,)<f8", "rad|m", "actuator position to follow, unless in effort"),
    Field("velocity", "(8,)<f8", "rad/s|m/s", "actuator velocity feed, unless in effort"),
    Field("effort", "(8,)<f8", "N·m|N", "actuator effort, used in effort mode"),
    Field("feed_forward", "(8,)<f8", "N·m|N", "actuator effort added in every mode"),
))

ARM_STATE = Topic("state", writer="arm", rate_hz=1500, fields=(
    Field("valid", "?", "", "joint values are valid: powered, biased, fresh"),
    Field("cartesian_valid", "?", "", "local Cartesian values are valid: joints valid and the chain complete"),
    Field("reference_valid", "?", "", "Cartesian values in the reference frame are valid: base frame known too"),
    Field("count", "u1", "", "kinematic joints in use"),
    Field("names", "(8,)S16", "", "joint names"),
    Field("position", "(8,)<f8", "rad|m", "measured joint position"),
    Field("velocity", "(8,)<f8", "rad/s|m/s", "measured joint velocity"),
    Field("effort", "(8,)<f8", "N·m|N", "measured joint effort"),
    Field("setpoint_position", "(8,)<f8", "rad|m", "joint setpoint as the joint controller accepted it"),
    Field("setpoint_velocity", "(8,)<f8", "rad/s|m/s", "joint setpoint velocity"),
    Field("setpoint_effort", "(8,)<f8", "N·m|N", "joint setpoint effort"),
    Field("has_jaw", "?", "", "an instrument with a jaw is attached"),
    Field("jaw_position", "<f8", "rad", "measured jaw angle"),
    Field("jaw_velocity", "<f8", "rad/s", "measured jaw velocity"),
    Field("jaw_effort", "<f8", "N·m", "measured jaw effort"),
    Field("jaw_setpoint_position", "<f8", "rad", "jaw setpoint"),
    Field("jaw_setpoint_effort", "<f8", "N·m", "jaw setpoint effort"),
    Field("gripper_valid", "?", "", "a master's gripper is measured, whether the arm has power or not"),
    Field("gripper_position", "<f8", "rad", "angle of a master's gripper, from its potentiometer"),
    Field("gripper_velocity", "<f8", "rad/s", "its velocity, smoothed"),
    Field("measured_cp", "(7,)<f8", "m, -", "measured tip pose in the reference frame: x y z, quaternion x y z w"),
    Field("setpoint_cp", "(7,)<f8", "m, -", "setpoint tip pose in the reference frame"),
    Field("local_measured_cp", "(7,)<f8", "m, -", "measured tip pose in the arm's base"),
    Field("local_setpoint_cp", "(7,)<f8", "m, -", "setpoint tip pose in the arm's base"),
    Field("measured_cv", "(6,)<f8", "m/s, rad/s", "tip twist in the reference frame, linear then angular"),
    Field("setpoint_cv", "(6,)<f8", "m/s, rad/s", "twist of the setpoint tip in the reference frame"),
    Field("local_measured_cv", "(6,)<f8", "m/s, rad/s", "twist of the tip in its own axes"),
    Field("body_measured_cf", "(6,)<f8", "N, N·m", "force and torque at the tip from the measured efforts, in "
          "its axes or, after body/set_cf_orientation_absolute, in those of the reference frame", "wrench"),
    Field("spatial_measured_cf", "(6,)<f8", "N, N·m", "the same at the origin of the arm's base, in its axes",
          "wrench"),
    Field("gravity_effort", "(8,)<f8", "N·m|N", "joint effort that compensates the arm's weight"),
    Field("jacobian", "(6,8)<f8", "", "body Jacobian at the tip, rows linear then angular"),
    Field("spatial_jacobian", "(6,8)<f8", "", "Jacobian of the twist at the base's origin, in the base's axes",
          "spatial_jacobian"),
    Field("state", "S16", "", "operating state as published: DISABLED, ENABLED, PAUSED, FAULT"),
    Field("sub_state", "S40", "", "internal state"),
    Field("desired_state", "S16", "", "requested state"),
    Field("reason", "S200", "", "cause of FAULT, or what the arm waits for, in words; empty: nothing"),
    Field("is_homed", "?", "", "homed, and powered"),
    Field("is_busy", "?", "", "a move or a transition is under way"),
    Field("control_mode", "u1", "", "0 none, 1 position, 2 trajectory, 3 effort"),
    Field("control_space", "u1", "", "space of the present goals: 0 none, 1 joint, 2 Cartesian"),
    Field("bias_generation", "<u4", "", "bias generation the homing belongs to, 0: not homed"),
    Field("stops", "<u4", "", "stops (hold, pause, disable) since its process began"),
    Field("stopped_by", "S48", "", "sender of the last one"),
    Field("simulated", "?", "", "KINEMATIC: there is no robot, its joints are ideal"),
    Field("tool", "S40", "", "instrument, empty: none is known to be attached"),
    Field("adapter", "u1", "", "PSM, sterile adapter: "
          "0 not looked at, 1 none, 2 present at start, 3 attached, 4 engaged"),
    Field("instrument", "u1", "", "PSM, instrument (engaged: the arm has its joints): "
          "0 not looked at, 1 none, 2 present at start, 3 attached, 4 engaged"),
    Field("emulated", "(2,)?", "", "PSM: adapter, instrument are emulated by command"),
    Field("reference_frame", "S24", "", "frame of measured_cp"),
    Field("base_frame", "(7,)<f8", "m, -", "pose of the arm's base in the reference frame"),
    Field("trajectory_ratio", "<f8", "", "ratio of moves, 0: those of velocity and acceleration differ"),
    Field("trajectory_ratio_v", "<f8", "", "velocity ratio of moves"),
    Field("trajectory_ratio_a", "<f8", "", "acceleration ratio of moves"),
), views=(
    View("measured_js", "js", (("name", "names"), ("position", "position"), ("velocity", "velocity"),
                               ("effort", "effort"))),
    View("setpoint_js", "js", (("name", "names"), ("position", "setpoint_position"),
                               ("velocity", "setpoint_velocity"), ("effort", "setpoint_effort"))),
    View("jaw/measured_js", "js", (("position", "jaw_position"), ("velocity", "jaw_velocity"),
                                   ("effort", "jaw_effort")), where="has_jaw"),
    View("jaw/setpoint_js", "js", (("position", "jaw_setpoint_position"), ("effort", "jaw_setpoint_effort")),
         where="has_jaw"),
    View("gripper/measured_js", "js", (("position", "gripper_position"), ("velocity", "gripper_velocity")),
         where="gripper_valid"),
    View("measured_cp", "cp", (("pose", "measured_cp"),), where="reference_valid"),
    View("setpoint_cp", "cp", (("pose", "setpoint_cp"),), where="reference_valid"),
    View("local/measured_cp", "cp", (("pose", "local_measured_cp"),), where="cartesian_valid"),
    View("local/setpoint_cp", "cp", (("pose", "local_setpoint_cp"),), where="cartesian_valid"),
    View("measured_cv", "cv", (("twist", "measured_cv"),), where="reference_valid"),
    View("setpoint_cv", "cv", (("twist", "setpoint_cv"),), where="reference_valid"),
    View("local/measured_cv", "cv", (("twist", "local_measured_cv"),), where="cartesian_valid"),
    View("body/measured_cf", "cf", (("wrench", "body_measured_cf"),), where="cartesian_valid"),
    View("spatial/measured_cf", "cf", (("wrench", "spatial_measured_cf"),), where="cartesian_valid"),
    View("body/jacobian", "jacobian", (("data", "jacobian"),), where="cartesian_valid"),
    View("spatial/jacobian", "jacobian", (("data", "spatial_jacobian"),), where="cartesian_valid"),
    View("gravity_compensation/setpoint_js", "js", (("name", "names"), ("effort", "gravity_effort"))),
))

# Written at start, when walls change, and 30 times a second while the arm is near one.
ARM_WALLS = Topic("walls", writer="arm", depth=8, fields=(
    Field("count", "u1", "", "walls in use"),
    Field("stopped_by", "S48", "", "wall, and other arm, that keep the arm from its goal now; empty: none"),
    Field("name", "(16,)S24", "", "names of the walls"),
    Field("shape", "(16,)S8", "", "plane, box, sphere, cylinder, cone, capsule or arms"),
    Field("keep", "(16,)S3", "", "out or in"),
    Field("of", "(16,)S10", "", "part of the arm: tip, jaw, shaft or instrument"),
    Field("frame", "(16,)S24", "", "base, reference or another arm, for its tip: the frame that the wall is given in"),
    Field("pose", "(16, 7)<f8", "m, -", "pose of the wall in that frame: x y z, quaternion x y z w"),
    Field("size", "(16, 3)<f8", "m|rad", "see docs/walls.md"),
    Field("margin", "(16,)<f8", "m", "distance that is kept besides"),
    Field("by_command", "(16,)?", "", "added by a command; false: of the system file"),
    Field("active", "(16,)?", "", "in force; false: where the wall is, or the instrument, is not known"),
    Field("distance", "(16,)<f8", "m", "of the setpoint from the wall, negative beyond it; NaN: not active"),
))

# The setup joints of a patient cart: every setup arm carries an arm of the system and provides its base frame.
SUJ_STATE = Topic("state", writer="suj", rate_hz=500, fields=(
    Field("valid", "?", "", "the poses of all setup arms are valid"),
    Field("state", "S16", "", "operating state as published: DISABLED, ENABLED, FAULT"),
    Field("sub_state", "S40", "", "internal state"),
    Field("desired_state", "S16", "", "requested state"),
    Field("reason", "S200", "", "cause of FAULT, or what they wait for, in words; empty: nothing"),
    Field("is_homed", "?", "", "homed, and enabled"),
    Field("is_busy", "?", "", "a transition is under way"),
    Field("simulated", "?", "", "there are no potentiometers: positions are those of the file, or as commanded"),
    Field("reference_arm", "S24", "", "setup arm of the reference arm, in whose tip base frames are given"),
    Field("lift", "<f8", "", "requested velocity of the lift, -1 to 1"),
    Field("rounds", "<u8", "", "complete readings of all potentiometers since start"),
    # setups: in the order of the file; `setups` of the header's info has their names and joints
    Field("setup_valid", "(setups,)?", "", "joints and local pose are valid: at rest, potentiometers agree"),
    Field("base_valid", "(setups,)?", "", "the pose in the reference frame is valid, and the reference arm's pose"),
    Field("position", "(setups,8)<f8", "rad|m", "measured joint position"),
    Field("local_measured_cp", "(setups,7)<f8", "m, -", "pose of the carried arm's base in the cart"),
    Field("measured_cp", "(setups,7)<f8", "m, -", "the same in the reference frame: the carried arm's base frame"),
    Field("reference_frame", "(setups,)S24", "", "frame of measured_cp: that of the reference arm's tip, or Cart"),
    Field("clutched", "(setups,)?", "", "it is moved by hand: button pressed, brakes released"),
    Field("brake_current", "(setups,)<f8", "A", "requested current of the brakes; NaN: io does not drive them"),
    Field("primary_voltage", "(setups,8)<f8", "V", "first potentiometers; for Si counts, not V"),
    Field("secondary_voltage", "(setups,8)<f8", "V", "second potentiometers; for Si counts, not V"),
    Field("extra_voltage", "(setups,4)<f8", "V", "other voltages of its plug: two spare ones, brakes, ground"),
), views=(
    View("measured_js", "js", (("position", "position"),), "setup", where="setup_valid"),
    View("measured_cp", "cp", (("pose", "measured_cp"),), "setup", where="base_valid"),
    View("local/measured_cp", "cp", (("pose", "local_measured_cp"),), "setup", where="setup_valid"),
    View("primary_voltage/measured_js", "js", (("position", "primary_voltage"),), "setup", where=""),
    View("secondary_voltage/measured_js", "js", (("position", "secondary_voltage"),), "setup", where=""),
))

SUJ_SETPOINT = replace(SETPOINT, writer="suj", rate_hz=500)  # currents of the brakes, in A, as efforts

BOARDS_STATE = Topic("state", writer="boards", rate_hz=1000, fields=(
    Field("board_ns", "<i8", "ns", "board time: simulated time the physics has reached"),
    Field("packets", "<u8", "", "datagrams answered or executed since start"),
    Field("position", "(axes,)<f8", "rad|m", "true actuator position in the order of the document's robots"),
    Field("velocity", "(axes,)<f8", "rad/s|m/s", "true actuator velocity"),
    Field("current", "(axes,)<f8", "A", "motor current that flows"),
    Field("amp_on", "(axes,)?", "", "amplifier output stage is on"),
    Field("watchdog", "(boards,)?", "", "the board's watchdog has fired and was not cleared"),
    Field("watchdog_ns", "(boards,)<i8", "ns", "board time at which the watchdog last fired, 0: never"),
    Field("refresh_ns", "(boards,)<i8", "ns", "board time of the last register write; the watchdog counts from it"),
    Field("amps_cut_ns", "(boards,)<i8", "ns", "board time at which the amplifiers last went off, 0: never"),
))

SUPERVISOR_STATE = Topic("state", writer="supervisor", depth=256, fields=(
    Field("instance", "(instances,)S64", "", "instance names"),
    Field("kind", "(instances,)S16", "", "kinds of process"),
    Field("lifecycle", "(instances,)S12", "", "STOPPED, RUNNING, STOPPING or RESTARTING"),
    Field("pid", "(instances,)<u4", "", "process, 0: none"),
    Field("restarts", "(instances,)<u4", "", "times it was started again"),
    Field("exit_reason", "(instances,)S480", "", "how it last ended, empty: never"),
))

SOCKET_STATE = Topic("state", writer="socket_bridge", rate_hz=1, depth=64, fields=(
    Field("clients", "<u4", "", "programs that are connected"),
    Field("subscriptions", "<u4", "", "of all of them"),
    Field("received", "<u8", "", "messages from clients since start"),
    Field("sent", "<u8", "", "records sent since start"),
    Field("lost", "<u8", "", "records that slow clients did not get"),
    Field("commands", "<u8", "", "commands passed on"),
    Field("refused", "<u8", "", "messages answered with an error"),
))

TOPICS: tuple[Topic, ...] = (
    IO_STATE, IO_GAINS, IO_INSTRUMENTS, SETPOINT, ARM_STATE, ARM_WALLS, SUJ_STATE, SUJ_SETPOINT, BOARDS_STATE,
    SUPERVISOR_STATE, TELEOP_STATE, CONSOLE_STATE, SYSTEM_STATE, FOCUS_STATE, SOCKET_STATE, GUI_STATE, RECORDER_STATE,
    THIRD_PARTY_STATE, EVENTS, COMMAND, REPLY, AUDIT,
)

# Rings that `trocar bench ring` sends back and forth; no process writes them, so they are not in the table.
PROBE = Topic("probe", writer="bench", depth=64, fields=(
    Field("payload", "(27,)<f8", "", "216 bytes, a small state record"),
))
PROBE_4K = replace(PROBE, name="probe4k", fields=(Field("payload", "(512,)<f8", "", "4096 bytes"),))
