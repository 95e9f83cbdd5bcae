"""THE TABLE of codes: every warning and error with the kinds of process that report it, its cause and its remedy.

Faults of io also have a number, which is shown in `fault` of io's record (0: none) and never reused.
docs/errors.md is generated from it: `python -m trocar.tools.pages.errors`.
"""

from __future__ import annotations

from typing import Final

from trocar.procs.tables.code_row import CUT, ERROR, JOINT, NOTHING, POWER_OFF, STOP, WARNING, Code

SENDER: Final = "ADDRESS:PORT"  # placeholder in the cause of a row
BUSY: Final = "the computer is too slow or too busy: see trocar doctor and docs/real-time.md"

# io: faults, by number
BAD_READS: Final = Code(
    "bad-reads", ERROR, "io", "the controllers sent no valid sample within the watchdog time",
    "check the cable and the controllers' supply, then trocar home NAME", 1, POWER_OFF, "s")
READ_MISSED: Final = Code(
    "read-missed", WARNING, "io",
    "a read of the controllers failed; until a read succeeds, io applies the last efforts, reduced in each cycle",
    "rare failures are harmless; if they are frequent, check the cable and the controller", 2, NOTHING, "s")
CURRENT: Final = Code(
    "current", ERROR, "io", "the motor current was above its limit for more than 100 cycles",
    "check for a blocked joint or a wrong current calibration, then trocar home NAME", 3, POWER_OFF, "A")
SAFETY_AMP_DISABLE: Final = Code(
    "safety-amp-disable", ERROR, "io",
    "the controller switched an amplifier off: measured and requested current differ",
    "check the motor cable and the current calibration, then trocar home NAME", 4, POWER_OFF)
TEMPERATURE: Final = Code(
    "temperature", ERROR, "io", "amplifier too hot",
    "let the controller cool down, check its fans and the load, then trocar home NAME", 5, POWER_OFF, "°C")
TEMPERATURE_HIGH: Final = Code(
    "temperature-high", WARNING, "io", "amplifier getting hot",
    "lower the load or improve the cooling", 6, NOTHING, "°C")
POTENTIOMETER: Final = Code(
    "potentiometer", ERROR, "io", "potentiometer and encoder disagree for longer than tolerated",
    "homing uses the potentiometer: first check it, its cable and its calibration, then trocar home NAME",
    7, POWER_OFF, JOINT)
ENCODER_OVERFLOW: Final = Code(
    "encoder-overflow", ERROR, "io", "encoder counter overflow",
    "check the encoder, then trocar home NAME", 8, POWER_OFF)
POWER_LOST: Final = Code(
    "power-lost", ERROR, "io, arm, suj", "motor power went off unexpectedly",
    "check the emergency stop and the safety chain, then trocar home NAME", 9, POWER_OFF)
POWER_TIMEOUT: Final = Code(
    "power-timeout", ERROR, "io, arm, suj", "motor power did not come on within 3 s",
    "check emergency stop, safety chain and the controllers' supply, then trocar home NAME", 10, POWER_OFF)
POWER_FAULT: Final = Code(
    "power-fault", ERROR, "io", "a controller reports a motor supply fault",
    "check the controllers' supply, then trocar home NAME", 11, POWER_OFF)
WATCHDOG: Final = Code(
    "watchdog", ERROR, "io", "a controller's watchdog has switched the amplifiers off",
    "trocar home NAME; if the fault recurs, the computer is too slow or too busy: trocar doctor", 12, POWER_OFF)
WATCHDOG_UNCONFIRMED: Final = Code(
    "watchdog-unconfirmed", WARNING, "io", "the watchdog period was written, but the controller does not confirm it",
    "check the controller's cable and supply; power stays off until the controller confirms", 33, NOTHING)
FIRMWARE_UNKNOWN: Final = Code(
    "firmware-unknown", WARNING, "io", "unknown firmware; its data look like Rev 9's",
    "load firmware Rev 9; to power the controller as it is, set io.unknown_firmware (docs/boards.md)", 34, NOTHING)
AMPLIFIER: Final = Code(
    "amplifier", ERROR, "io, arm, suj", "an amplifier is off although it should be on",
    "check the motor cable for a short circuit, check the amplifier's temperature, then trocar home NAME",
    13, POWER_OFF)
TRACKING: Final = Code(
    "tracking", ERROR, "io", "the joint controller cannot follow its setpoint",
    "check for a collision, a command that is too fast, or an encoder jump, then trocar home NAME", 14, STOP, JOINT)
NOT_FINITE: Final = Code(
    "not-finite", ERROR, "io", "a setpoint or a requested current was not a finite number",
    "the value did not reach the motors; correct the program that sent it, then trocar home NAME", 15, STOP)
ARM_LOST: Final = Code(
    "arm-lost", ERROR, "io", "the arm's process has sent no setpoints for too long; io holds the arm",
    "if the process does not resume by itself: trocar start NAME; if in doubt, power off", 16, NOTHING, "s")
ARM_LOST_POWER_OFF: Final = Code(
    "arm-lost-power-off", ERROR, "io", "the arm's process still sends no setpoints; io switched the power off",
    "trocar restart NAME, then trocar home NAME; the key io.arm_lost_power_off_s sets the time", 17, POWER_OFF, "s")
BIAS_FAILED: Final = Code(
    "bias-failed", ERROR, "io", "an encoder does not read the value to which it was set",
    "trocar home NAME again; if the fault recurs, check encoder, cable and controller", 18, NOTHING, JOINT, "set to")
SHARED_BOARD: Final = Code(
    "shared-board", ERROR, "io", "another arm on the same controller had a fault; power was switched off",
    "remove the cause of the other arm's fault, then trocar home NAME", 19, POWER_OFF)
POT_MISSING: Final = Code(
    "pot-missing", ERROR, "io", "a potentiometer reading is not in its lookup table; the safety relays were opened",
    "check the arm's cable, and the serial number in its lookup table; move the joint by hand; then trocar home NAME",
    20, CUT)
CURRENT_ERROR: Final = Code(
    "current-error", ERROR, "io", "measured and requested motor current differ for longer than tolerated",
    "check motor, cable and current calibration; io.current_error_a and io.current_error_s set the tolerance",
    21, POWER_OFF, "A")
CALIBRATION_MODE: Final = Code(
    "calibration-mode", WARNING, "io", "calibration mode: potentiometers are not compared with encoders",
    "use this mode only to calibrate; to restore the checks, remove calibration_mode", 22, NOTHING)
CALIBRATION_MOTORS: Final = Code(
    "calibration-motors", WARNING, "io", "in calibration mode, the motor amplifiers of a dRA1 controller stay off",
    "you can release brakes and move the arm by hand; to use the motors, switch calibration_mode off", 23, NOTHING)
PERIOD: Final = Code(
    "period", ERROR, "io", "over one second, the average period of the I/O loop was more than twice the set period",
    f"{BUSY}, or set a longer io.period_s", 24, STOP, "s")
PERIOD_LONG: Final = Code(
    "period-long", WARNING, "io", "on average over one second, an I/O cycle took longer than the set period",
    f"{BUSY}, or set a longer io.period_s", 25, NOTHING, "s")
FOREIGN_DATAGRAMS: Final = Code(
    "foreign-datagrams", WARNING, "io", f"datagrams from {SENDER} are ignored: no controller has this address",
    "find the program that sends them; connect the controllers to a network that only io uses", 26, NOTHING)
BOARD_AWAY: Final = Code(
    "board-away", ERROR, "io", "the controller has left the bus: it has no power, or its cable is unplugged",
    "check the controller's supply and cables, then trocar home NAME; other controllers are not affected",
    27, POWER_OFF)
TASK_OVER_BUDGET: Final = Code(
    "task-over-budget", ERROR, "io", "a user's task in the I/O cycle was too slow; io no longer runs it",
    "make the task's step faster, or raise its budget_us (docs/in-cycle.md)", 31, NOTHING)
TASK_FAILED: Final = Code(
    "task-failed", ERROR, "io", "an in-cycle task failed and was detached",
    "correct the task's module, then restart the io process, which loads it again (docs/in-cycle.md)", 32, NOTHING)

# any process
HELD_UP: Final = Code(
    "held-up", WARNING, "any",
    "a process stalled, because it was suspended or got no CPU time; it was restarted, as after a kill",
    "if frequent, the machine is too slow or too busy: trocar doctor; or raise processes.NAME.late_s")

# supervisor
PROCESS_ENDED: Final = Code(
    "process-ended", WARNING, "supervisor", "a process ended by itself", "trocar logs NAME may say why it ended")
PROCESS_KILLED: Final = Code("process-killed", WARNING, "supervisor", "a process did not stop in time, and was killed",
                             "trocar logs NAME may say why")
PROCESS_LATE: Final = Code(
    "process-late", WARNING, "supervisor", "a process sent no heartbeat for longer than its late_s",
    "if frequent, the machine is too slow or too busy: trocar doctor; docs/real-time.md")
MEMORY_REMOVED: Final = Code(
    "memory-removed", WARNING, "supervisor",
    "another program removed files of this system from /dev/shm; the robot continues",
    "to restore them: trocar down, then trocar up; if logind removes them at logout: sudo loginctl enable-linger USER")

# boards
BOARDS_LATE: Final = Code(
    "boards-late", WARNING, "boards", "the emulated boards stalled; during the stall, the emulated robots stood still",
    "the machine was suspended, or is too busy; if it is too busy, reserve a core for the emulation")

# arm, suj: causes of FAULT
IO_TIMEOUT: Final = Code(
    "io-timeout", ERROR, "arm, suj", "io does not answer",
    "wait until io is back, or start it by its name with trocar start; then trocar home NAME")
IO_RESTARTED: Final = Code(
    "io-restarted", ERROR, "arm, suj", "io was restarted", "trocar home NAME; the log of io may say why")
IO_FAULT: Final = Code(
    "io-fault", ERROR, "arm, suj", "io reports a fault with an unknown number",
    "run the same version of Trocar in all processes")
PID_OFF: Final = Code(
    "pid-off", ERROR, "arm, suj", "another program switched the joint controller off, or off and on again",
    "trocar logs --commands shows which program did so; then trocar home NAME")
BIAS_CHANGED: Final = Code(
    "bias-changed", ERROR, "arm", "the encoders were set again while the joint controller was on",
    "trocar logs --commands shows which program did so; then trocar home NAME")
IO_SWITCH: Final = Code(
    "io-switch", ERROR, "arm", "io did not carry out a request in time",
    "remove the cause named in the event or in io's log, then trocar home NAME")
BIAS_TIMEOUT: Final = Code(
    "bias-timeout", ERROR, "arm", "the encoders were not set from the potentiometers in time",
    "check that trocar echo IO1/NAME/pot/measured_js gives the arm's real pose; then trocar home NAME")
HOMING_PLAN: Final = Code(
    "homing-plan", ERROR, "arm", "no trajectory to the home position was found",
    "move the arm by hand, away from the limits of its joints, then trocar home NAME")
HOMING_TIMEOUT: Final = Code(
    "homing-timeout", ERROR, "arm", "the arm did not reach its home position in time",
    "remove obstacles, check the tolerances in the PID file, then trocar home NAME")
ROLL_PLAN: Final = Code(
    "roll-plan", ERROR, "arm", "no path to the stop of the roll joint was found",
    "turn the roll to mid-range, then trocar home NAME")
ROLL_PASSED: Final = Code(
    "roll-passed", ERROR, "arm", "the roll went past the expected position of its lower stop",
    "check the roll's stop and its encoder, then trocar home NAME")
ROLL_TIMEOUT: Final = Code(
    "roll-timeout", ERROR, "arm", "the roll did not reach its lower stop in time",
    "turn it by hand, check the roll's motor and cable, then trocar home NAME")
ROLL_ENCODER: Final = Code(
    "roll-encoder", ERROR, "arm", "the roll's encoder was not set at the lower stop",
    "trocar home NAME again; if the fault recurs, check the encoder")
ROLL_CHECK: Final = Code(
    "roll-check", ERROR, "arm", "the roll's encoder does not read the value to which it was set",
    "trocar home NAME again; if the fault recurs, check the encoder")
ENGAGING_PLAN: Final = Code(
    "engaging-plan", ERROR, "arm", "no trajectory was found that engages the adapter or instrument",
    "remove the adapter or instrument, and attach it again")

# arm: reported, without FAULT
IO_REFUSED: Final = Code(
    "io-refused", WARNING, "arm, suj", "io refused a request",
    "trocar logs --commands lists all requests to io with sender, outcome and reason")
COMMAND_REFUSED: Final = Code(
    "command-refused", WARNING, "arm, suj, teleop", "a command was refused and had no effect",
    "the message gives the reason; trocar send NAME lists the commands of NAME")
OWN_STATE: Final = Code(
    "own-state", WARNING, "arm",
    "the code of a state that you added to an arm requested something impossible; the arm left the state, and holds",
    "change the state's code as the message says (docs/derived-arms.md)")
NOT_READY: Final = Code(
    "not-ready", WARNING, "arm", "a motion command or a clutch press was ignored, because the arm is not homed",
    "trocar home NAME")
UNKNOWN_FRAME: Final = Code(
    "unknown-frame", WARNING, "arm", "a command was given in a frame that the arm does not know",
    "use the arm's reference frame or base frame; to ignore the frames of ROS messages, set ros.check_frames: false")
NOT_INSERTED: Final = Code(
    "not-inserted", WARNING, "arm", "Cartesian motion was requested before the tip was past the cannula",
    "insert the instrument or endoscope further, by hand or with move_jp")
NEAR_RCM: Final = Code(
    "near-rcm", WARNING, "arm", "a goal is too close to the remote centre, where there is no solution",
    "give a goal farther from the remote centre")
INVERSE_KINEMATICS: Final = Code(
    "inverse-kinematics", ERROR, "arm",
    "the goal of a move, or the first pose of a stream, is out of reach, and was refused",
    "give a pose within reach")
AT_LIMIT: Final = Code(
    "at-limit", WARNING, "arm", "a pose of a stream is out of reach; the arm goes as near as its limits allow",
    "move the goal back within reach")
AT_WALL: Final = Code(
    "at-wall", WARNING, "arm", "a goal of a stream is beyond a wall; the arm stays on the allowed side",
    "move the goal back; docs/walls.md says how to remove a wall")
WALL_IN_THE_WAY: Final = Code(
    "wall-in-the-way", WARNING, "arm", "a move would cross a wall; it was refused",
    "move round the wall in several moves, or remove it (docs/walls.md)")
WALL_OFF: Final = Code(
    "wall-off", WARNING, "arm",
    "the position of a wall is not known; the wall's key `unknown` decides whether the wall is off or the arm holds",
    "set the base frame, or home the setup joints")
OTHER_ARM_GONE: Final = Code(
    "other-arm-gone", WARNING, "arm",
    "the instrument of a near arm is no longer detected; the wall no longer keeps this arm away from it",
    "check whether the instrument was really removed; the wall acts again when an instrument is attached")
CLIPPED: Final = Code(
    "clipped", WARNING, "arm", "a goal was beyond the limits of a joint, and was clipped",
    "give goals within the joint limits")
EFFORT_CLIPPED: Final = Code(
    "effort-clipped", WARNING, "arm", "requested efforts exceeded the limits of motors or joints, and were clipped",
    "request smaller efforts")
STREAM_JUMP: Final = Code(
    "stream-jump", WARNING, "arm", "a goal of a stream is too far away; the stream has ended, and the arm holds",
    "begin the stream at the arm's present setpoint, or use move_jp or move_cp")
STREAM_REFUSED: Final = Code(
    "stream-refused", WARNING, "arm", "goals were refused: the stream was stopped, or another program is streaming",
    "if your stream was stopped, send no goals for 0.5 s; if another program streams, end its stream with hold")
SPEED_LIMITED: Final = Code(
    "speed-limited", WARNING, "arm", "a stream exceeds the maximum speed of a joint; the arm lags behind it",
    "stream more slowly, with smaller steps from goal to goal")
CLIENT_TIMEOUT: Final = Code(
    "client-timeout", WARNING, "arm", "the program that streamed goals went silent; the arm holds",
    "find out why it stopped or was too slow, then stream again")
EFFORT_TIMEOUT: Final = Code(
    "effort-timeout", WARNING, "arm, teleop",
    "the program that sent efforts or wrenches went silent; the arm has stopped applying them",
    "repeat efforts and wrenches at least every 0.1 s for as long as they should act")
ORIENTATION_LOCK: Final = Code(
    "orientation-lock", WARNING, "arm", "an orientation cannot be locked, or can no longer be held",
    "turn the master's gripper until its wrist is away from its limits")
ADAPTER_MISSING: Final = Code(
    "adapter-missing", WARNING, "arm", "an instrument is attached, but no sterile adapter is detected",
    "check the adapter and its switch")
TOOL_UNKNOWN: Final = Code(
    "tool-unknown", ERROR, "arm", "the instrument could not be read or is not in the list",
    "name the instrument: trocar send NAME set_tool_type TYPE")
TOOL_NOT_NAMED: Final = Code(
    "tool-not-named", WARNING, "arm", "an instrument is attached, but neither its file nor its chip identifies it",
    "trocar send NAME set_tool_type TYPE; without TYPE, the command lists the known types")
ENDOSCOPE_TYPE: Final = Code(
    "endoscope-type", ERROR, "arm", "an endoscope name is unknown", "use one of the names in the message")
CPU_OVERLOAD: Final = Code(
    "cpu-overload", WARNING, "arm", "the machine is overloaded: the arm runs only in every other period", BUSY)

# setup joints
CLUTCH_RELEASED: Final = Code(
    "clutch-released", WARNING, "suj", "a clutch command has ended: a minute has passed, or power went off",
    "if needed, clutch again")
CLUTCH_STUCK: Final = Code(
    "clutch-stuck", WARNING, "io, suj",
    "a button of the setup joints was already pressed at power-on or at the start; it has no effect until released",
    "release the button; if the button is not pressed, check it and its cable")
MULTIPLEXER_CHANNEL: Final = Code(
    "multiplexer-channel", WARNING, "suj", "the interface board reports a channel other than the requested one",
    "rare reports are harmless; if they are frequent, check the board and its cable")
MULTIPLEXER_STUCK: Final = Code(
    "multiplexer-stuck", ERROR, "suj", "the interface board does not switch channels; setup arm positions are unknown",
    "check the board, its supply and its cable")
SETUP_POTS: Final = Code(
    "setup-pots", ERROR, "suj", "the two potentiometers of a joint differ by more than 1° or 2 mm (Si: 2°, 3 mm)",
    "check cable and calibration")
SETUP_MOVED: Final = Code(
    "setup-moved", WARNING, "suj", "a setup arm has moved without being clutched",
    "its brakes slip: have them serviced")
SETUP_BOARD: Final = Code(
    "setup-board", WARNING, "suj", "a potentiometer board of an Si cart cannot be reached, or sends invalid data",
    "check the board's supply, and that the board is within Bluetooth range")

# teleoperations
FAULT_SINCE: Final = Code(
    "fault-since", ERROR, "teleop", "a fault occurred after the teleoperation was requested",
    "enable the teleoperation again: trocar send CONSOLE teleop_enable 1")
ARM_ERROR: Final = Code(
    "arm-error", ERROR, "teleop", "an arm of this teleoperation reported an error; following has stopped",
    "follow the remedy of the arm's error, then enable teleoperation again")
ARM_TIMEOUT: Final = Code(
    "arm-timeout", ERROR, "teleop", "an arm of this teleoperation is silent; following has stopped",
    "if its process or program has ended, start it: trocar start NAME; then pinch or twist the master's gripper")
ARM_RESTARTED: Final = Code(
    "arm-restarted", ERROR, "teleop", "an arm of this teleoperation was restarted; following has stopped",
    "pinch or twist the master's gripper to follow again; trocar logs NAME says why the arm ended")
ARM_IMPLAUSIBLE: Final = Code(
    "arm-implausible", ERROR, "teleop",
    "a master jumped, or a third-party arm sends implausible values; following has stopped",
    "pinch or twist the master's gripper; if this recurs, check encoders and program (docs/third-party-masters.md)")
ARM_CLUTCHED: Final = Code(
    "arm-clutched", WARNING, "teleop", "an arm of this teleoperation is being moved by hand; following has stopped",
    "release the arm's clutch, then pinch or twist the master's gripper")
ARM_NOT_READY: Final = Code(
    "arm-not-ready", ERROR, "teleop", "an arm of this teleoperation is no longer enabled and homed",
    "trocar home NAME, then enable teleoperation again")
ARM_STOPPED: Final = Code(
    "arm-stopped", WARNING, "teleop", "another program stopped an arm of this teleoperation; teleoperation has ended",
    "press the pedal again, or enable teleoperation again")
ARM_TAKEN: Final = Code(
    "arm-taken", WARNING, "teleop",
    "another program is moving a master, or sent it the command hold; following has stopped",
    "end that program, then pinch or twist the master's gripper")
ARM_SETUP_TIMEOUT: Final = Code(
    "arm-setup-timeout", ERROR, "teleop", "an arm of this teleoperation was not enabled and homed in time",
    "trocar home NAME, then enable teleoperation again")
BASE_FRAME: Final = Code(
    "base-frame", ERROR, "teleop", "the base frame of an arm of this teleoperation was changed; following has stopped",
    "pinch or twist the master's gripper to follow again")
POSE_UNKNOWN: Final = Code(
    "pose-unknown", ERROR, "teleop", "the pose of an arm or of a base frame is not known",
    "wait until the setup joints are read and at rest, or give the arm a base frame (set_base_frame)")
MASTER_OUTSIDE: Final = Code(
    "master-outside", ERROR, "teleop", "a master is too far away from you to move the camera",
    "bring the masters back in front of you and press the pedal again")
CAMERA_JUMP: Final = Code(
    "camera-jump", ERROR, "teleop", "the camera would jump: the hands are crossed, or one is behind the other",
    "bring your hands side by side and press the pedal again")
NO_JAW: Final = Code("no-jaw", ERROR, "teleop", "the slave has no jaw to follow the gripper",
                     "attach an instrument that has a jaw, or set ignore_jaw")
TOOL_CHANGED: Final = Code("tool-changed", ERROR, "teleop", "the slave's instrument was changed while it followed",
                           "enable teleoperation again")
OPERATOR_TIMEOUT: Final = Code(
    "operator-timeout", ERROR, "teleop", "the console was silent while the camera moved; following has stopped",
    "press the pedal again; if the console does not restart by itself: trocar start NAME")
OPERATOR_ABSENT: Final = Code(
    "operator-absent", WARNING, "teleop", "no operator detected at the console; following has stopped",
    "return to the console: press the operator's pedal, or place your head in front of the head sensor")
TELEOP_WAITING: Final = Code(
    "teleop-waiting", WARNING, "teleop", "the teleoperation waits for a condition before it follows",
    "do what the message says; usually, pinch or twist the master's gripper")

# console, system, third-party programs
TELEOP_DISABLED: Final = Code(
    "teleop-disabled", WARNING, "console", "an arm had a fault; teleoperation is no longer enabled",
    "once the fault is fixed: trocar send NAME teleop_enable 1")
HEAD_SENSOR: Final = Code(
    "head-sensor", WARNING, "console",
    "the head sensor was plugged in or unplugged; without a sensor, the operator counts as absent",
    "if it should be plugged in, check its cable, and the permission to read its device file")
TELEOP_REFUSED: Final = Code("teleop-refused", WARNING, "console", "a teleoperation refused a request of the console",
                             "trocar status shows the teleoperation's reason")
SYSTEM_INCOMPLETE: Final = Code("system-incomplete", ERROR, "system", "power_on, home or power_off did not succeed for "
                                "all arms", "trocar status says what to do first")
BEEP_CLIPPED: Final = Code(
    "beep-clipped", WARNING, "system", "a parameter of a beep was out of range; the nearest allowed value was used",
    "give values within the range in docs/teleoperation.md")
SOUND_FAILED: Final = Code("sound-failed", WARNING, "system", "a sound could not be played",
                           "sounds are for information only; nothing else is affected")
THIRD_PARTY_ERROR: Final = Code(
    "third-party-error", ERROR, "third_party", "a third-party program that provides an arm reports an error",
    "correct the error in that program; enable the teleoperations of this arm again")
ROS_MESSAGE: Final = Code(
    "ros-message", WARNING, "third_party",
    "an arm provided by a ROS program sent a warning, or its message was refused",
    "check the program that provides the arm; docs/ros.md lists its topics")
ROS_REFUSED: Final = Code("ros-refused", WARNING, "ros_bridge", "a command from ROS was refused, or did not succeed",
                          "docs/commands.md lists the arguments of each command")

# users' processes
USER_ERROR: Final = Code(
    "user-error", ERROR, "user", "a user process reports a problem",
    "fix the named problem; if the process does not resume by itself: trocar restart NAME")
USER_SLOW: Final = Code(
    "user-slow", WARNING, "filters", "a filter took longer than its period; other filters in its process had to wait",
    "make the filter's update faster, give its process a longer period, or give the filter its own process")

# recorder
RECORDING_DROPPED: Final = Code(
    "recording-dropped", WARNING, "recorder", "the disk is full or too slow, so some records were lost",
    "check that the folder is writable and has free space; to keep less: trocar set recorder.minutes 5")
FAULT_RECORDED: Final = Code(
    "fault-recorded", WARNING, "recorder", "a fault occurred; the records before it were saved to a file",
    "examine the file as docs/recordings.md describes")

CODES: Final = tuple(row for row in globals().values() if isinstance(row, Code))
FAULTS: Final = tuple(row for row in CODES if row.number)
