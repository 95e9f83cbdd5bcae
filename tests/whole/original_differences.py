"""THE TABLE of differences from the original's runs (tests/whole/test_original.py): where, which, and why.

A reason begins with a mark: [K] ours is kept, [F] ours is wrong, [Q] it was open, and was decided
(docs/coming-from-dvrk.md). A line counts for the first row that it fits.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

ALL: Final = "psm mtm ecm teleop"
ARMS: Final = "psm mtm ecm"


@dataclass(frozen=True)
class Difference:
    """In `runs`, in `steps`, `lines` of OriginalRobot.differences (both regular expressions, for the whole)."""

    runs: str
    steps: str
    lines: str
    reason: str

    def fits(self, difference: str) -> bool:
        """Whether it is about this one."""
        step, _, line = difference.partition("/")[2].partition(" | ")
        return bool(re.fullmatch(self.steps, step) and re.fullmatch(self.lines, line))


MOVED: Final = r"setpoint_[cj]p off by .*"
AS_REFUSED: Final = r"\w+ events [-+] (goal_reached \w+|operating_state (\w+)\|\2\|homed=[01]\|busy=[01]|"\
                    r"operating_state ENABLED\|HOMED\|homed=1\|busy=[01])"
BROKEN: Final = "move_jp|servo_jp|move_cp|servo_cp|jaw move_jp"

DIFFERENCES: Final = (
    # texts
    Difference(ALL, ".*", r"\w+ current_state - .*", "[K] an arm's own state is part of its operating_state"),
    Difference(ALL, ".*", r"\w+ messages - status \(control\)", "[Q] control_mode, control_space say it"),
    Difference(ALL, ".*", r"\w+ messages - status \(desired state\)", "[Q] desired_state says it"),
    Difference("psm mtm teleop", ".*", r"\w+ messages - status \(effort cartesian\)",
               "[K] each wrench says whose axes it has"),
    Difference(ARMS, "home( again)?|set_endoscope_type.*|(pause|disable) in a move|resume", r"\w+ messages - status",
               "[K] what changed is an event or a state; the texts that repeat it are left out"),
    Difference("psm", "ratio (0.0|-1.0|2.0|nan)", "PSM1 messages - warning",
               "[K] the sender gets the refusal; over ROS it is a warning for all"),
    # states
    Difference(ARMS, "home( again)?", r"\w+ events [-+] operating_state ENABLED\|(?!HOMED).*",
               "[K] is_homed is true in the final state only; stages without work for a KINEMATIC arm are not shown"),
    Difference("psm", "home", r"PSM1 events - operating_state ENABLED\|HOMED\|homed=1\|busy=0",
               "[K] an engagement that is not needed is not shown"),
    Difference(ALL, "disable( in a move)?|resume disabled|home from disabled|power_off",
               r"(\w+ events [-+] operating_state |state )DISABLED\|DISABLED\|.*", "[K] is_homed ends with the power"),
    Difference("psm", "(pause|disable) in a move", r"PSM1 events - operating_state ENABLED\|HOMED\|homed=1\|busy=0",
               "[K] the state itself says that the move has ended"),
    Difference("psm", "(home after )?unhome", r"(PSM1 (desired_state|events|messages) \+ |state ).*",
               "[K] unhome returns to ENABLED, so that home has an effect"),
    Difference(ARMS, "initial|.*disabled|enable( again)?|move_jp enabled unhomed|disable.*", "setpoint_[cj]p not valid",
               "[K] without power or homing there is no setpoint"),
    # refusals
    Difference("psm", "move_jp (disabled|enabled unhomed|paused)|servo_jp disabled",
               rf"{AS_REFUSED}|PSM1 messages \+ warning", "[K] refused with a reason, not ignored"),
    Difference("psm", f"({BROKEN}) (nan|inf)", rf"{AS_REFUSED}|PSM1 (desired_state|messages) - .*|state .*|"
               rf"jaw off by .*|PSM1 events - operating_state DISABLED.*|{MOVED}", "[K] NaN is refused"),
    Difference("psm", "move after inf", r"PSM1 (events [-+] .*|messages - status)", "[K] no endless move has to end"),
    Difference("psm", "move_jp size [57]", f"{AS_REFUSED}|{MOVED}", "[K] a wrong number of joints is refused"),
    Difference("psm", "move_cp (far|not inserted)", f"{AS_REFUSED}|{MOVED}|PSM1 messages [+] error",
               "[K] a goal that cannot be reached is refused"),
    Difference("psm", "servo_cp not inserted", MOVED, "[K] the move before was refused"),
    Difference("psm", "move_cp not a rotation", AS_REFUSED, "[K] refused, and said so"),
    Difference("psm", "servo_cp far", r"PSM1 .*|state .*|setpoint_.*", "[K] a jump is refused; the original trips"),
    Difference("psm", "servo_jp jump .2", MOVED, "[K] goals are followed at a bounded speed"),
    # limits
    Difference("psm", "jaw move_jp 5|move_j[pr] out of limits|servo_[cj]p stream past limit",
               r"PSM1 messages \+ warning", "[K] a goal that is clipped is reported"),
    Difference("psm", "servo_cp stream past limit", r"setpoint_(jp off by 5\.\d|cp off by 1\.\d)e-03",
               "[K] the tip goes to the nearest place that it reaches, not each joint to its limit"),
    # times
    Difference("psm", "hold in move|servo_jp in a move|pause in a move|move_jp paused|(home after )?resume",
               r"setpoint_[cj]p off by [5-9]\.\de-03", "[K] a move lasts as long as planned; there not"),
    # poses, masters
    Difference(ARMS, "enable( again)?|move_jp enabled unhomed", "setpoint_cp off by .*",
               "[K] the tip is known with the power, the original's is computed from homing on"),
    Difference("psm", "home again", r"\w+ events \+ tool_type .*", "[Q] each homing says it"),
    Difference("mtm", "move_cp|servo_cp stream", r"setpoint_jp off by (8\.\de-02|1\.\de-01)",
               "[Q] the platform stays where it is while the yaw is far from its limits"),
    Difference("mtm", "lock_orientation .*|move_jp locked|unlock", r"MTMR events [-+] orientation_locked \w+",
               "[K] only an arm that follows wrenches is locked, and a move ends the lock"),
    Difference("psm", "home|emulate_tool_present 1", r"PSM1 events [-+] tool_type \w+:\d+.*",
               "[K] versions are named only where an entry is limited to some"),
    # teleoperation
    Difference("teleop", ".*", r"console messages - status", "[K] the buttons are topics"),
    Difference("teleop", "teleop.enable|teleop disable|power_off", r"console messages \+ status",
               "[K] that teleoperation is enabled or disabled is said, too"),
    Difference("teleop", ".*", r"MTM[LR] messages - warning", "[K] that a master has no gravity model is said once"),
    Difference("teleop", "master moves clutched|clutch release|lock_rotation|unlock_rotation|ecm: masters moved|"
               "camera release", r"MTM[LR] events [-+] orientation_locked \w+",
               "[K] joint goals for a master end its lock, and the clutch's lock ends where its move begins"),
    Difference("teleop", "camera press", "MTMR_PSM1 messages - warning", "[K] a warning about the past"),
    Difference("teleop", "set_scale (-1|5)", r"MTMR_PSM1 (messages \+ warning|scale - .*)",
               "[K] scales from above 0 to 1 are accepted"),
    Difference("teleop", "ecm: masters moved", r"MTM[LR] setpoint_cp off by .*",
               "[K] joint goals are followed; there a lock, renewed in each cycle, turns the wrist back"),
    Difference("teleop", "(?!ecm).*", r"(MTM[LR]|PSM1) setpoint_cp off by [1-9]\.\de-0[23]",
               "[Q] a master aligns with less platform travel: from there the same joint goals turn it elsewhere"),
    Difference("teleop", "master (rotation|tr locked)", r"MTMR messages \+ warning",
               "[K] a goal that is clipped is reported"),
    Difference("teleop", "teleop_enable", "MTML_PSM2 messages - warning", "[Q] it is aligned sooner"),
    Difference("teleop", "camera release|teleop disable", r"MTMR events [-+] .*|MTMR_PSM1 (following|messages) - .*",
               "[Q] the wrist of the right master still turns: its platform stays where it is"),
    # instruments
    Difference("psm", "emulate_tool_present [01]|move_jp without tool",
               r"setpoint_jp has \(7,\).*|setpoint_cp not valid|setpoint_[cj]p off by 1\.0e-01|"
               r"PSM1 events [-+] goal_reached .*",
               "[K] without an instrument there is no tip, and the joints are the robot's seven; six are refused"),
    Difference("psm", "set_tool_type valid", r"PSM1 events \+ tool_type .*|PSM1 messages - status",
               "[K] another instrument is an event"),
    Difference("psm", "set_tool_type unknown", r"PSM1 events - tool_type ERROR|PSM1 messages - .*",
               "[K] an unknown name is refused with the names that there are, and changes nothing"),
)
