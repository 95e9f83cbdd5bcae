"""THE TABLE of codes: every warning and error with the kinds of process that report it, its cause and its remedy.

Faults of io also have a number, which is shown in `fault` of io's record (0: none) and never reused.
docs/errors.md is generated from it: `python -m trocar.tools.pages.errors`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

WARNING: Final = 2
ERROR: Final = 3
NOTHING: Final = 0
STOP: Final = 1  # joint controller off, zero current
POWER_OFF: Final = 2  # and amplifiers and motor power off
CUT: Final = 3  # and the safety relays opened

JOINT: Final = "joint"
SENDER: Final = "ADDRESS:PORT"  # placeholder in the cause of a row
BUSY: Final = "the computer is too slow or too busy: trocar doctor, docs/operating.md (real time)"


@dataclass(frozen=True, slots=True, eq=False)
class Code:
    """One row: `cause` describes the problem in one sentence, `remedy` the actions to take.

    `owner`: the kinds of process that report it, or "any". For faults of io: `action` is NOTHING, STOP, POWER_OFF or
    CUT; `unit` is that of value and limit, JOINT: rad or m by axis, empty: no value; `bound` describes the limit.
    """

    code: str
    severity: int
    owner: str
    cause: str
    remedy: str
    number: int = 0
    action: int = NOTHING
    unit: str = ""
    bound: str = "allowed"

    def remedy_for(self, component: str) -> str:
        """The remedy, with the name of the arm or process concerned."""
        return self.remedy.replace("NAME", component) if component else self.remedy


# io: faults, by number
BAD_READS: Final = Code(
    "bad-reads", ERROR, "io", "no good sample from the controllers within the watchdog time",
    "check the cable and the controllers' supply, then trocar home NAME", 1, POWER_OFF, "s")
READ_MISSED: Final = Code(
    "read-missed", WARNING, "io", "a read of the controllers failed; the last output is kept",
    "once in a while is harmless; often means a bad cable, or a failing controller", 2, NOTHING, "s")
CURRENT: Final = Code(
    "current", ERROR, "io", "measured motor current above its limit for more than 100 cycles",
    "look for a blocked joint or a wrong current calibration", 3, POWER_OFF, "A")
SAFETY_AMP_DISABLE: Final = Code(
    "safety-amp-disable", ERROR, "io", "the controller cut an amplifier: measured and requested current differ",
    "check the motor cable and the current calibration, then trocar home NAME", 4, POWER_OFF)
TEMPERATURE: Final = Code(
    "temperature", ERROR, "io", "amplifier too hot",
    "let the controller cool down, check its fans and the load", 5, POWER_OFF, "°C")
TEMPERATURE_HIGH: Final = Code(
    "temperature-high", WARNING, "io", "amplifier getting hot",
    "lower the load or improve the cooling", 6, NOTHING, "°C")
POTENTIOMETER: Final = Code(
    "potentiometer", ERROR, "io", "potentiometer and encoder disagree for longer than tolerated",
    "trocar home NAME; if it returns, check potentiometer, calibration and tolerance (IO file)", 7, POWER_OFF, JOINT)
ENCODER_OVERFLOW: Final = Code(
    "encoder-overflow", ERROR, "io", "encoder counter overflow",
    "check the encoder, then trocar home NAME", 8, POWER_OFF)
POWER_LOST: Final = Code(
    "power-lost", ERROR, "io, arm", "motor power went off unexpectedly",
    "check the emergency stop and the safety chain, then trocar home NAME", 9, POWER_OFF)
POWER_TIMEOUT: Final = Code(
    "power-timeout", ERROR, "io, arm", "motor power did not come on in 3 s",
    "check the emergency stop, the safety chain and the controllers' supply", 10, POWER_OFF)
POWER_FAULT: Final = Code(
    "power-fault", ERROR, "io", "a controller reports a motor supply fault",
    "check the controllers' supply", 11, POWER_OFF)
WATCHDOG: Final = Code(
    "watchdog", ERROR, "io", "a controller's watchdog has cut the amplifiers",
    "trocar home NAME; if it returns, the computer is too slow or too busy: trocar doctor", 12, POWER_OFF)
WATCHDOG_UNCONFIRMED: Final = Code(
    "watchdog-unconfirmed", WARNING, "io", "the watchdog period was written, and the controller does not show it",
    "it gets no power until it does; check its cable and its supply", 33, NOTHING)
AMPLIFIER: Final = Code(
    "amplifier", ERROR, "io, arm", "an amplifier is off although it should be on",
    "check the motor cable; a short circuit or overheating makes an amplifier fail", 13, POWER_OFF)
TRACKING: Final = Code(
    "tracking", ERROR, "io", "the joint controller cannot follow its setpoint",
    "look for a collision or a too fast command; the tolerance is in the PID file", 14, STOP, JOINT)
NOT_FINITE: Final = Code(
    "not-finite", ERROR, "io", "a setpoint or a requested current was not a finite number",
    "a program sent NaN or infinity; nothing of it reached the motors", 15, STOP)
ARM_LOST: Final = Code(
    "arm-lost", ERROR, "io", "the arm's process has sent no setpoints for too long; holding",
    "if it does not come back by itself: trocar start NAME; power off if in doubt", 16, NOTHING, "s")
ARM_LOST_POWER_OFF: Final = Code(
    "arm-lost-power-off", ERROR, "io", "the arm's process stayed away; power was switched off",
    "trocar restart NAME, then trocar home NAME", 17, POWER_OFF, "s")
BIAS_FAILED: Final = Code(
    "bias-failed", ERROR, "io", "an encoder did not take the value it was set to",
    "try again; if it returns, look at the potentiometers' values", 18, NOTHING, JOINT, "set to")
SHARED_BOARD: Final = Code(
    "shared-board", ERROR, "io", "another robot on the same controller had a fault; power was switched off",
    "remove the cause of the other robot's fault, then trocar home NAME", 19, POWER_OFF)
POT_MISSING: Final = Code(
    "pot-missing", ERROR, "io", "a potentiometer reads where its table has no position; relays were opened",
    "check that the table belongs to this arm, and the arm's cable; move the joint by hand and try again", 20, CUT)
CURRENT_ERROR: Final = Code(
    "current-error", ERROR, "io", "measured and requested motor current differ for longer than tolerated",
    "check motor, motor cable and current calibration; see io.current_error_a, io.current_error_s", 21, POWER_OFF, "A")
CALIBRATION_MODE: Final = Code(
    "calibration-mode", WARNING, "io", "calibration mode: potentiometers are not compared with encoders",
    "for calibrating only; without calibration_mode the checks are back", 22, NOTHING)
CALIBRATION_MOTORS: Final = Code(
    "calibration-motors", WARNING, "io", "in calibration mode the motor amplifiers of a dRA1 stay off",
    "brakes can be released and the arm moved by hand; switch calibration_mode off to use the motors", 23, NOTHING)
PERIOD: Final = Code(
    "period", ERROR, "io", "the I/O loop took more than twice its period on average over a second",
    f"{BUSY}, io.period_s", 24, STOP, "s")
PERIOD_LONG: Final = Code(
    "period-long", WARNING, "io", "an I/O cycle works longer than its period on average over a second",
    f"{BUSY}, io.period_s", 25, NOTHING, "s")
FOREIGN_DATAGRAMS: Final = Code(
    "foreign-datagrams", WARNING, "io", f"datagrams from {SENDER} are ignored: no controller is there",
    "find the program that sends them; on a network of their own only io reaches the controllers", 26, NOTHING)
BOARD_AWAY: Final = Code(
    "board-away", ERROR, "io", "the controller has left the bus: it has no power, or its cable is out",
    "check its supply and its cables; the other controllers are not affected; then trocar home NAME", 27, POWER_OFF)
TASK_OVER_BUDGET: Final = Code(
    "task-over-budget", ERROR, "io", "an in-cycle task was too slow and was detached",
    "shorten its step or raise its budget_us (docs/in-cycle.md)", 31, NOTHING)
TASK_FAILED: Final = Code(
    "task-failed", ERROR, "io", "an in-cycle task failed and was detached",
    "correct its module, then restart its io process, which loads it (docs/in-cycle.md)", 32, NOTHING)

# any process
HELD_UP: Final = Code(
    "held-up", WARNING, "any",
    "a process was stopped, starved of a core or suspended, and began anew as if it had been killed",
    "often: the machine is too slow or too busy (trocar doctor), or allow more: processes.NAME.late_s")

# supervisor
PROCESS_ENDED: Final = Code(
    "process-ended", WARNING, "supervisor", "a process ended by itself",
    "trocar logs NAME may say why it ended")
PROCESS_KILLED: Final = Code(
    "process-killed", WARNING, "supervisor", "a process that was asked to end did not, and was killed",
    "trocar logs NAME may say why; where it was an io, the boards' watchdog has switched its amplifiers off")
PROCESS_LATE: Final = Code(
    "process-late", WARNING, "supervisor", "a process that should go on was silent for longer than its late_s",
    "often: the machine is too slow or too busy (trocar doctor, docs/operating.md)")

# boards
BOARDS_LATE: Final = Code(
    "boards-late", WARNING, "boards", "the emulated boards were held up; the robots stood still meanwhile",
    "the machine is too busy, or was suspended; give the emulation a core of its own")

# arm: causes of FAULT
IO_TIMEOUT: Final = Code(
    "io-timeout", ERROR, "arm", "io does not answer",
    "wait until io is back, or start it by its name with trocar start; then trocar home NAME")
IO_RESTARTED: Final = Code(
    "io-restarted", ERROR, "arm", "io was restarted", "trocar home NAME; the log of io may say why it ended")
IO_FAULT: Final = Code(
    "io-fault", ERROR, "arm", "io reports a fault whose number is not known here",
    "start all parts from the same version")
PID_OFF: Final = Code(
    "pid-off", ERROR, "arm", "another program switched the joint controller off, or off and on again",
    "trocar home NAME; trocar logs --commands says by whom")
BIAS_CHANGED: Final = Code(
    "bias-changed", ERROR, "arm", "the encoders were set anew while the joint controller was on",
    "trocar home NAME; trocar logs --commands says by whom")
IO_SWITCH: Final = Code(
    "io-switch", ERROR, "arm", "io did not do what it was asked for in time",
    "trocar home NAME; if it returns, the log of io says what is missing")
BIAS_TIMEOUT: Final = Code(
    "bias-timeout", ERROR, "arm", "the encoders were not set from the potentiometers in time",
    "look at the potentiometers' values")
HOMING_PLAN: Final = Code(
    "homing-plan", ERROR, "arm", "there is no motion to the home position",
    "move the arm by hand, away from the limits of its joints")
HOMING_TIMEOUT: Final = Code(
    "homing-timeout", ERROR, "arm", "the arm did not reach its home position in time",
    "remove what is in its way; look at the tolerances in the PID file")
ROLL_PLAN: Final = Code(
    "roll-plan", ERROR, "arm", "there is no motion to the lower stop of the roll", "turn the roll by hand")
ROLL_PASSED: Final = Code(
    "roll-passed", ERROR, "arm", "the roll went past where its lower stop should be",
    "check the roll's stop and its encoder")
ROLL_TIMEOUT: Final = Code(
    "roll-timeout", ERROR, "arm", "the roll did not come to its lower stop in time",
    "turn it by hand; check the roll's motor and cable")
ROLL_ENCODER: Final = Code(
    "roll-encoder", ERROR, "arm", "the roll's encoder was not set at the lower stop",
    "home again; if it returns, check the encoder")
ROLL_CHECK: Final = Code(
    "roll-check", ERROR, "arm", "the roll's encoder does not read what it was set to",
    "home again; if it returns, check the encoder")
ENGAGING_PLAN: Final = Code(
    "engaging-plan", ERROR, "arm", "there is no motion that engages the adapter or instrument",
    "take it off and put it on again")

# arm: reported, without FAULT
IO_REFUSED: Final = Code(
    "io-refused", WARNING, "arm, suj", "io refused what it was asked for",
    "trocar logs --commands lists what io was asked for, by whom, and what became of it")
COMMAND_REFUSED: Final = Code(
    "command-refused", WARNING, "arm, suj, teleop", "a command was refused, and nothing of it done",
    "trocar send NAME lists what can be asked of it")
OWN_STATE: Final = Code(
    "own-state", WARNING, "arm", "a state of a derived arm asked for what cannot be done; it has ended, the arm holds",
    "change its code as the text says (docs/derived-arms.md)")
NOT_READY: Final = Code(
    "not-ready", WARNING, "arm", "motion was asked of an arm that is not homed, or its clutch was pressed",
    "trocar home NAME")
NOT_INSERTED: Final = Code(
    "not-inserted", WARNING, "arm", "Cartesian motion was asked before the tip is past the cannula",
    "insert the instrument or endoscope further, by hand or with move_jp")
NEAR_RCM: Final = Code(
    "near-rcm", WARNING, "arm", "a goal is too close to the remote centre, where there is no solution",
    "give a goal that is further in")
INVERSE_KINEMATICS: Final = Code(
    "inverse-kinematics", ERROR, "arm", "a pose that was asked for cannot be reached; the command was refused",
    "give a pose within reach")
AT_LIMIT: Final = Code(
    "at-limit", WARNING, "arm", "a pose that was asked for lies beyond; the arm follows along its limit",
    "move the goal back")
CLIPPED: Final = Code(
    "clipped", WARNING, "arm", "a goal lay beyond the limits of a joint; the arm went as far as it may",
    "give goals within the limits of these joints")
EFFORT_CLIPPED: Final = Code(
    "effort-clipped", WARNING, "arm", "efforts beyond what motors and joints bear were taken as the largest allowed",
    "ask for less")
STREAM_JUMP: Final = Code(
    "stream-jump", WARNING, "arm", "a goal of a stream is too far away; the stream has ended, and the arm holds",
    "stream from where the arm is (setpoint), or use move_jp, move_cp")
STREAM_REFUSED: Final = Code(
    "stream-refused", WARNING, "arm", "goals were refused: the stream was stopped, or another program is streaming",
    "pause for 0.5 s before the next stream; let one program at a time stream to an arm")
SPEED_LIMITED: Final = Code(
    "speed-limited", WARNING, "arm", "a stream asks for more than the largest speed of a joint; the arm lags behind it",
    "stream goals that are closer together")
CLIENT_TIMEOUT: Final = Code(
    "client-timeout", WARNING, "arm", "the program that streamed goals went silent; the arm holds",
    "see why it stopped or was too slow; stream anew")
EFFORT_TIMEOUT: Final = Code(
    "effort-timeout", WARNING, "arm, teleop", "the program that gave efforts or wrenches went silent; they have ended",
    "send them again within 0.1 s for as long as they are to act")
ORIENTATION_LOCK: Final = Code(
    "orientation-lock", WARNING, "arm", "an orientation cannot be locked, or no longer be kept",
    "turn the gripper away from its limit")
ADAPTER_MISSING: Final = Code(
    "adapter-missing", WARNING, "arm", "there is an instrument, and no sterile adapter is seen",
    "check the adapter and its switch")
TOOL_UNKNOWN: Final = Code(
    "tool-unknown", ERROR, "arm", "the instrument could not be read or is not in the list",
    "name it: trocar send NAME set_tool_type TYPE")
TOOL_NOT_NAMED: Final = Code(
    "tool-not-named", WARNING, "arm", "an instrument is on, and neither file nor memory say which",
    "trocar send NAME set_tool_type without a name lists those there are")
ENDOSCOPE_TYPE: Final = Code(
    "endoscope-type", ERROR, "arm", "an endoscope of this name is not known",
    "give one of those that are allowed")
CPU_OVERLOAD: Final = Code(
    "cpu-overload", WARNING, "arm", "the machine is short of time: the arm works in every second or third period only",
    BUSY)

# setup joints
SUJ_FAULT: Final = Code(
    "suj-fault", ERROR, "suj", "the setup joints have lost power or their io; brakes hold", "remove the cause")
CLUTCH_RELEASED: Final = Code(
    "clutch-released", WARNING, "suj", "a clutch that a command had pressed was released after a minute",
    "clutch again if you still need it")
CLUTCH_STUCK: Final = Code(
    "clutch-stuck", WARNING, "io, suj", "a button of the setup joints was already pressed when they got power or "
    "their process began; it has no effect until it is released",
    "release the button; if it is not pressed, check it and its cable")
MULTIPLEXER_CHANNEL: Final = Code(
    "multiplexer-channel", WARNING, "suj", "the interface board shows another channel than it was told to",
    "once in a while is harmless; often: check the board and its cable")
MULTIPLEXER_STUCK: Final = Code(
    "multiplexer-stuck", ERROR, "suj", "the interface board does not count; where the setup arms are is not known",
    "check the board, its supply and its cable")
SETUP_POTS: Final = Code(
    "setup-pots", ERROR, "suj", "the two potentiometers of a joint differ by more than 1° or 2 mm (Si: 2°, 3 mm)",
    "look at cable and calibration")
SETUP_MOVED: Final = Code(
    "setup-moved", WARNING, "suj", "a setup arm stands elsewhere although nobody clutched it",
    "its brakes slip: have them looked at")
SETUP_BOARD: Final = Code(
    "setup-board", WARNING, "suj", "a potentiometer board of an Si cart cannot be reached, or sends nonsense",
    "check the board's supply and distance")

# teleoperations
FAULT_SINCE: Final = Code(
    "fault-since", ERROR, "teleop", "there was a fault since the teleoperation was asked for",
    "enable teleoperation again (teleop_enable of its console)")
ARM_ERROR: Final = Code(
    "arm-error", ERROR, "teleop", "one of its arms reported an error; following has stopped",
    "do what the arm's error says, then enable teleoperation again")
ARM_TIMEOUT: Final = Code(
    "arm-timeout", ERROR, "teleop", "one of its arms is silent; following has stopped",
    "if it stays away, start it again: trocar start NAME, or its own program; then show presence again")
ARM_RESTARTED: Final = Code(
    "arm-restarted", ERROR, "teleop", "one of its arms was started again; following has stopped",
    "show presence again; trocar logs NAME says why the arm ended")
ARM_IMPLAUSIBLE: Final = Code(
    "arm-implausible", ERROR, "teleop",
    "a master jumped, or a third-party arm sends what cannot be; following has stopped",
    "show presence again; if it recurs, check the master's encoders or the program (docs/third-party-masters.md)")
ARM_CLUTCHED: Final = Code(
    "arm-clutched", WARNING, "teleop", "one of its arms is moved by hand; following has stopped",
    "let go of the arm's clutch and show presence again")
ARM_NOT_READY: Final = Code(
    "arm-not-ready", ERROR, "teleop", "one of its arms is no longer enabled and homed",
    "trocar home NAME, then enable teleoperation again")
ARM_STOPPED: Final = Code(
    "arm-stopped", WARNING, "teleop", "another program stopped one of its arms; teleoperation has ended",
    "press the pedal again, or enable teleoperation again")
ARM_TAKEN: Final = Code(
    "arm-taken", WARNING, "teleop", "another program moves a master, or made it hold; following has stopped",
    "end that program and show presence again")
ARM_SETUP_TIMEOUT: Final = Code(
    "arm-setup-timeout", ERROR, "teleop", "one of its arms did not get enabled and homed in time",
    "trocar home NAME, then enable teleoperation again")
BASE_FRAME: Final = Code(
    "base-frame", ERROR, "teleop", "the base frame of one of its arms was changed; following has stopped",
    "show presence again")
POSE_UNKNOWN: Final = Code(
    "pose-unknown", ERROR, "teleop", "the pose of an arm or of a base frame is not known",
    "wait for the setup joints, or give the arm a base frame (set_base_frame)")
MASTER_OUTSIDE: Final = Code(
    "master-outside", ERROR, "teleop", "a master is too far out to move the camera with",
    "bring the masters back in front of you and press the pedal again")
CAMERA_JUMP: Final = Code(
    "camera-jump", ERROR, "teleop", "the camera would jump: hands crossed, or one behind the other",
    "bring the hands side by side and press the pedal again")
NO_JAW: Final = Code(
    "no-jaw", ERROR, "teleop", "the slave has no jaw to follow the gripper",
    "mount an instrument or set ignore_jaw")
TOOL_CHANGED: Final = Code(
    "tool-changed", ERROR, "teleop", "the slave's instrument was changed while it followed",
    "enable teleoperation again")
OPERATOR_TIMEOUT: Final = Code(
    "operator-timeout", ERROR, "teleop", "the console went silent while the camera was moved; following has stopped",
    "press the pedal again; if the console does not come back by itself: trocar start NAME")
OPERATOR_ABSENT: Final = Code(
    "operator-absent", WARNING, "teleop", "nobody is seen at the console; following has stopped",
    "show presence again: pedal or head sensor")
TELEOP_WAITING: Final = Code(
    "teleop-waiting", WARNING, "teleop", "the teleoperation waits before it follows",
    "do what it waits for, most often move the gripper")

# console, system, third-party programs
TELEOP_DISABLED: Final = Code(
    "teleop-disabled", WARNING, "console", "an arm had a fault; teleoperation is no longer enabled",
    "when all is well again: trocar send NAME teleop_enable 1")
HEAD_SENSOR: Final = Code(
    "head-sensor", WARNING, "console", "a head sensor came or went; without it the operator counts as absent",
    "where it went: check its cable, and who may read it")
TELEOP_REFUSED: Final = Code(
    "teleop-refused", WARNING, "console", "a teleoperation refused what the console asked of it",
    "do what the teleoperation's reason in trocar status asks for")
SYSTEM_INCOMPLETE: Final = Code(
    "system-incomplete", ERROR, "system", "the system's power_on, home or power_off did not succeed for all arms",
    "trocar status says what to do first")
BEEP_CLIPPED: Final = Code(
    "beep-clipped", WARNING, "system", "a beep was asked for with a value out of range; the nearest one was taken",
    "give values within the range in docs/operating.md")
SOUND_FAILED: Final = Code(
    "sound-failed", WARNING, "system", "a sound could not be made",
    "sounds only inform, nothing else is affected")
THIRD_PARTY_ERROR: Final = Code(
    "third-party-error", ERROR, "third_party", "a third-party program that is an arm reports an error",
    "see that program; teleoperations that use it stop")
ROS_REFUSED: Final = Code(
    "ros-refused", WARNING, "ros_bridge", "a command from ROS was refused, or did not succeed",
    "the message says why; docs/commands.md lists what each topic takes")

# users' processes
USER_ERROR: Final = Code(
    "user-error", ERROR, "user", "a process of a user's own reports that something is wrong with it",
    "remove what it names; if it does not resume by itself: trocar restart NAME")
USER_SLOW: Final = Code(
    "user-slow", WARNING, "filters", "a filter took longer than its period, and the others of its process waited",
    "make its update faster, its process's period longer, or give it a process of its own")

# recorder
RECORDING_DROPPED: Final = Code(
    "recording-dropped", WARNING, "recorder", "the disk is full or too slow, something was not recorded",
    "see that their folder may be written and has room; trocar set recorder.minutes 5 keeps less")
FAULT_RECORDED: Final = Code(
    "fault-recorded", WARNING, "recorder", "there was a fault; what led to it is kept in a file",
    "look at the file: docs/operating.md, What was recorded")

CODES: Final = tuple(row for row in globals().values() if isinstance(row, Code))
FAULTS: Final = tuple(row for row in CODES if row.number)
