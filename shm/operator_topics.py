"""Topic-table rows of the operator side: teleoperations, consoles, the system, browsers, third-party programs.

Sizes in brackets: `teleops` those of a console, `arms` those of the system, `inputs` the buttons that consoles take
from a program; the names are in the header's info and, except for `inputs`, in the record.
"""

from __future__ import annotations

from enum import StrEnum

from trocar.shm.memory.rows import Field, Topic, View


class TeleopState(StrEnum):
    """States of a teleoperation, as published."""

    DISABLED = "DISABLED"
    SETTING = "SETTING_ARMS_STATE"
    ALIGNING = "ALIGNING_MTM"
    ENABLED = "ENABLED"


TELEOP_STATE = Topic("state", writer="teleop", rate_hz=1000, fields=(
    Field("valid", "?", "", "the states of all its arms are fresh and their poses valid"),
    Field("kind", "S4", "", "PSM or ECM"),
    Field("masters", "(2,)S40", "", "MTM; for an ECM teleoperation MTML and MTMR"),
    Field("slave", "S40", "", "PSM or ECM"),
    Field("console", "S40", "", "console it belongs to"),
    Field("state", "S24", "", f"{', '.join((*TeleopState,)[:-1])} or {TeleopState.ENABLED}"),
    Field("desired_state", "S24", "", "requested state"),
    Field("following", "?", "", "the slave follows"),
    Field("is_busy", "?", "", "on the way to the desired state"),
    Field("reason", "S160", "", "what it waits for or why it does not follow, in words; empty: nothing"),
    Field("clutched", "?", "", "the clutch is pressed"),
    Field("operator_active", "?", "", "the operator has shown presence by gripper or roll"),
    Field("scale", "<f8", "", "ratio of the slave's motion to the master's"),
    Field("rotation_locked", "?", "", "the slave's orientation stays"),
    Field("translation_locked", "?", "", "the slave's position stays"),
    Field("align_mtm", "?", "", "the master is aligned with the slave before following"),
    Field("mtm_is_haptic", "?", "", "the master takes commands"),
    Field("angle_error", "<f8", "rad", "between the orientations of master and slave; ECM: 0"),
    Field("gripper_range", "<f8", "rad", "how far the gripper was moved since alignment"),
    Field("roll_range", "<f8", "rad", "how far the master was rolled since alignment"),
    Field("gripper_ghost", "<f8", "rad", "gripper angle that the jaw is driven with"),
    Field("alignment_offset", "(4,)<f8", "", "rotation from master to slave in the master's axes: x y z w"),
    Field("mtm_measured_cp", "(7,)<f8", "m, -", "pose of the master as used: x y z, quaternion x y z w"),
    Field("mtm_measured_cv", "(6,)<f8", "m/s, rad/s", "its twist, linear then angular"),
    Field("psm_setpoint_cp", "(7,)<f8", "m, -", "setpoint of the slave as used"),
    Field("goal_cp", "(7,)<f8", "m, -", "last pose sent to the slave; ECM: NaN"),
    Field("goal_jp", "(4,)<f8", "rad|m", "last joint positions sent to an ECM; PSM: NaN"),
    Field("jaw_goal", "<f8", "rad", "last jaw angle sent"),
    Field("master_stamp_ns", "(2,)<i8", "ns", "stamps of the masters' records used"),
    Field("slave_stamp_ns", "<i8", "ns", "stamp of the slave's record used"),
    Field("sent_ns", "<i8", "ns", "when the last goal was sent to the slave, 0: never"),
), views=(
    View("MTM/measured_cp", "cp", (("pose", "mtm_measured_cp"),)),
    View("MTM/measured_cv", "cv", (("twist", "mtm_measured_cv"),)),
    View("PSM/setpoint_cp", "cp", (("pose", "psm_setpoint_cp"),)),
    View("alignment_offset", "turn", (("orientation", "alignment_offset"),)),
))

CONSOLE_STATE = Topic("state", writer="console", rate_hz=100, fields=(
    Field("valid", "?", "", "every wired input is fresh; false: the operator counts as absent"),
    Field("input_type", "S32", "", "as in the system file"),
    Field("operator_present", "?", "", "the operator is present"),
    Field("clutch", "?", "", "the clutch is pressed"),
    Field("camera", "?", "", "the camera pedal is pressed"),
    Field("teleop_enabled", "?", "", "teleoperation is requested"),
    Field("origin", "<u8", "", "number of the operator's command that requested it, 0: none"),
    Field("generation", "<u8", "", "fault generation of the system at that command"),
    Field("program", "S16", "", "program that sent that command"),
    Field("scale", "<f8", "", "last scale requested for all its teleoperations"),
    Field("teleop", "(teleops,)S40", "", "names, those of the ECM first"),
    Field("kind", "(teleops,)S4", "", "ECM or PSM"),
    Field("selected", "(teleops,)?", "", "selected; of teleoperations that share an arm, at most one is"),
    Field("asked", "(teleops,)S12", "", "last request to it: enable, align_MTM or disable"),
    Field("present_inputs", "u1", "", "number of inputs that detect the operator; a head sensor has several"),
))

SYSTEM_STATE = Topic("state", writer="system", rate_hz=100, fields=(
    Field("arm", "(arms,)S40", "", "names"),
    Field("arm_fresh", "(arms,)?", "", "the arm's process publishes"),
    Field("arm_state", "(arms,)S16", "", "operating states"),
    Field("arm_homed", "(arms,)?", "", "homed, and powered"),
    Field("arm_busy", "(arms,)?", "", "a move or a transition is under way"),
    Field("task", "S16", "", "power_on or home while it is under way, else empty"),
    Field("waiting", "S400", "", "what that waits for"),
    Field("calibration_mode", "?", "", "potentiometers and currents are being calibrated: some checks are off"),
    Field("volume", "<f8", "", "of beeps and speech, 0 to 1"),
    Field("sound", "S32", "", "programs that make sounds; none: it is silent"),
    Field("beeps", "<u4", "", "beeps since start, heard or not"),
    Field("errors", "<u4", "", "errors of all processes since start"),
    Field("warnings", "<u4", "", "warnings of all processes since start"),
    Field("shown_arm", "S88", "", "arm, or SUJ/setup arm, of which a program shows a pose in 3D; empty: none"),
    Field("shown_position", "(8,)<f8", "rad|m", "joint positions of that pose; NaN: none"),
))

FOCUS_STATE = Topic("state", writer="focus", rate_hz=100, fields=(
    Field("valid", "?", "", "the io that moves the lens publishes"),
    Field("locked", "?", "", "nothing moves the lens"),
    Field("focusing", "(2,)?", "", "the lens is moved: in, out"),
))

GUI_STATE = Topic("state", writer="gui", rate_hz=1, depth=64, fields=(
    Field("browsers", "<u4", "", "pages that are connected"),
    Field("watching", "<u4", "", "number of those that are visible and request data"),
    Field("controlling", "S40", "", "operator in control, else the browser's address and port; empty: none"),
    Field("sent", "<u8", "", "messages with data sent since start"),
    Field("lost", "<u8", "", "number of those that slow browsers did not get"),
    Field("commands", "<u8", "", "commands passed on"),
    Field("refused", "<u8", "", "messages answered with an error"),
))

RECORDER_STATE = Topic("state", writer="recorder", depth=64, fields=(
    Field("system_ns", "<i8", "ns", "the system's time, monotonic or simulated: that of all stamps"),
    Field("monotonic_ns", "<i8", "ns", "CLOCK_MONOTONIC at that moment"),
    Field("local_ns", "<i8", "ns", "time of day at that moment, since 1970 UTC"),
    Field("box_bytes", "<u8", "", "size of the black box's files since start"),
    Field("box_messages", "<u8", "", "messages of the black box since start"),
    Field("dropped", "<u8", "", "messages of black box and faults that could not be written"),
    Field("waiting_bytes", "<u8", "", "messages that wait for the disk"),
    Field("name", "S60", "", "recording under way, empty: none"),
    Field("path", "S300", "", "file of that recording, or of the last one"),
    Field("passed_s", "<f8", "s", "its duration so far, in the system's time"),
    Field("bytes", "<u8", "", "its size on the disk"),
    Field("messages", "<u8", "", "messages in it"),
    Field("lost", "<u8", "", "records of it that are missing"),
    Field("fault_path", "S300", "", "file of the last fault that was kept since start, empty: there was none"),
    Field("fault_first_ns", "<i8", "ns", "monotonic time of the first fault in it, 0: it was saved on request"),
    Field("fault_last_ns", "<i8", "ns", "monotonic time of the last one"),
    Field("problem", "S200", "", "error of the disk, empty: none"),
))

# Data of third-party programs: a master, a slave or pedals. Arm fields have the same names as in an arm's record.
THIRD_PARTY_STATE = Topic("state", writer="third_party", rate_hz=200, fields=(
    Field("program", "S40", "", "name of the program"),
    Field("state", "S16", "", "operating state: DISABLED, ENABLED, PAUSED, FAULT"),
    Field("sub_state", "S40", "", "the same in the program's own words"),
    Field("is_homed", "?", "", "ready for use"),
    Field("is_busy", "?", "", "a move or a transition is under way"),
    Field("control_mode", "u1", "", "0 none, 1 position, 3 effort"),
    Field("simulated", "?", "", "forces do not move it: it carries out no body/servo_cf"),
    Field("reference_valid", "?", "", "poses and twist are known"),
    Field("reference_frame", "S24", "", "frame of the poses"),
    Field("measured_cp", "(7,)<f8", "m, -", "measured tip pose in the reference frame: x y z, quaternion x y z w"),
    Field("setpoint_cp", "(7,)<f8", "m, -", "setpoint tip pose in the reference frame"),
    Field("measured_cv", "(6,)<f8", "m/s, rad/s", "tip twist in the reference frame, linear then angular"),
    Field("gripper_valid", "?", "", "a master's gripper is measured"),
    Field("gripper_position", "<f8", "rad", "angle of a master's gripper"),
    Field("has_jaw", "?", "", "an instrument with a jaw is attached"),
    Field("jaw_setpoint_position", "<f8", "rad", "jaw setpoint"),
    Field("setpoint_position", "(8,)<f8", "rad|m", "joint setpoint; of an ECM yaw, pitch, insertion, roll"),
    Field("tool", "S40", "", "instrument, empty: none is known to be attached"),
    Field("stops", "<u4", "", "stops (hold, pause, disable) since the program began"),
    Field("stopped_by", "S48", "", "sender of the last one"),
    Field("age_ns", "<i8", "ns", "age of the buttons when this record was written"),
    Field("input", "(inputs,)?", "", "buttons, true: pressed"),
), views=(
    View("measured_cp", "cp", (("pose", "measured_cp"),), where="reference_valid"),
    View("setpoint_cp", "cp", (("pose", "setpoint_cp"),), where="reference_valid"),
    View("measured_cv", "cv", (("twist", "measured_cv"),), where="reference_valid"),
    View("gripper/measured_js", "js", (("position", "gripper_position"),), where="gripper_valid"),
    View("jaw/setpoint_js", "js", (("position", "jaw_setpoint_position"),), where="has_jaw"),
))
