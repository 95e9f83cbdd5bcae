"""The steps of the original's runs, played on a robot of ours: the same commands in the same order."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from tests.whole.original_robot import OriginalRobot, Rows
from trocar.procs.kinematics.poses import rotation_from_vector

NAN: Final = math.nan
Joints = Sequence[float]


def swing(t: float, seconds: float = 1.0) -> float:
    """From 0 to 1, at rest at both ends."""
    return (1.0 - math.cos(math.pi * t / seconds)) / 2.0


def circle(t: float) -> Rows:
    """A circle of 10 mm in a second, from its start."""
    return 0.01 * np.array([math.cos(2.0 * math.pi * t) - 1.0, math.sin(2.0 * math.pi * t), 0.0])


class Player:
    """Steps of one arm."""

    def __init__(self, robot: OriginalRobot, arm: str) -> None:
        self.robot, self.arm = robot, arm

    def says(self, step: str, command: str = "", values: Sequence[float] | Rows = (), text: str = "") -> None:
        """A step of one command, or of none."""
        with self.robot.step(step):
            if command:
                self.robot.ask(self.arm, command, tuple(values), text)

    def state(self, step: str, word: str) -> None:
        self.says(step, "state_command", text=word)

    def move(self, step: str, *joints: float) -> None:
        self.says(step, "move_jp", joints)

    def broken(self, step: str, joints: Joints, seconds: float, command: str, values: Sequence[float] | Rows = (),
               text: str = "") -> None:
        """A move that another command breaks after `seconds`."""
        with self.robot.step(step):
            self.robot.start(self.arm, "move_jp", joints, seconds=seconds)
            self.robot.ask(self.arm, command, tuple(values), text)

    def servo(self, step: str, command: str, goal: Callable[[float], Rows], seconds: float = 1.0) -> None:
        """A step of one stream."""
        with self.robot.step(step):
            self.robot.stream(self.arm, command, goal, seconds)

    def servo_circle(self, step: str) -> None:
        start = self.robot.tip(self.arm)
        self.servo(step, "servo_cp", lambda t: start + np.append(circle(t), np.zeros(4)))

    def tip(self, *shift: float, turn: Rows | None = None) -> Rows:
        return self.robot.tip(self.arm, shift or (0.0, 0.0, 0.0), turn)


def zero(first: float = 0.0) -> Joints:
    return first, 0.0, 0.12, 0.0, 0.0, 0.0


def psm(robot: OriginalRobot) -> None:
    """One PSM with a large needle driver."""
    p = Player(robot, "PSM1")
    psm_states(p)
    psm_moves(p)
    psm_jaw_and_frame(p)
    psm_ratios(p)
    psm_sizes_and_limits(p)
    psm_pauses(p)
    psm_efforts_and_tools(p)
    psm_nan(p)


def psm_states(p: Player) -> None:
    p.says("initial")
    p.move("move_jp disabled", *zero(0.1))
    p.says("servo_jp disabled", "servo_jp", zero(0.1))
    p.state("pause disabled", "pause")
    p.state("unhome disabled", "unhome")
    p.state("enable", "enable")
    p.move("move_jp enabled unhomed", *zero(0.1))
    p.state("home", "home")


def psm_moves(p: Player) -> None:
    p.move("move_jp 1", 0.3, -0.2, 0.15, 0.5, 0.3, -0.3)
    p.says("move_jr 1", "move_jr", (0.05, 0.05, -0.02, 0.1, -0.1, 0.1))
    p.move("move_jp 0-length", *p.robot.joints(p.arm))
    p.says("move_cp 1", "move_cp", p.tip(0.02, -0.01, 0.015, turn=rotation_from_vector(
        0.3 * np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0))))
    start = p.robot.joints(p.arm)
    p.servo("servo_jp stream", "servo_jp",
            lambda t: start + np.array([0.1, 0.1, 0.02, 0.2, 0.1, 0.1]) * swing(2.0 * t))
    p.servo_circle("servo_cp stream")
    p.move("move_jp back", *zero())
    p.broken("hold in move", zero(0.6), 0.4, "hold")
    p.move("move after hold", *zero())
    p.broken("move replaced", zero(0.6), 0.4, "move_jp", (-0.3, 0.2, 0.15, 0.2, 0.0, 0.0))
    with p.robot.step("servo_jp in a move"):
        p.robot.start(p.arm, "move_jp", zero(), seconds=0.3)
        p.robot.ask(p.arm, "servo_jp", p.robot.joints(p.arm))
    with p.robot.step("move_cp replaced by move_jp"):
        p.robot.start(p.arm, "move_cp", p.tip(0.01), seconds=0.15)
        p.robot.ask(p.arm, "move_jp", zero())


def psm_jaw_and_frame(p: Player) -> None:
    p.says("jaw move_jp .8", "jaw/move_jp", (0.8,))
    p.says("jaw servo_jp .75", "jaw/servo_jp", (0.75,))
    p.says("jaw move_jp 5", "jaw/move_jp", (5.0,))
    p.says("jaw move_jp -0.3", "jaw/move_jp", (-0.3,))
    p.broken("jaw move during arm move", (0.2, 0.0, 0.14, 0.0, 0.0, 0.0), 0.1, "jaw/move_jp", (0.5,))
    with p.robot.step("arm move during jaw move"):
        p.robot.start(p.arm, "jaw/move_jp", (0.0,), seconds=0.1)
        p.robot.ask(p.arm, "move_jp", zero())
    p.says("set_base_frame", "set_base_frame", (0.1, 0.2, 0.3, 0.0, 0.0, math.sin(0.25), math.cos(0.25)), "world")
    p.says("move_cp in base frame", "move_cp", p.tip(0.01))
    p.says("set_base_frame id", "set_base_frame", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "PSM1_base")
    p.move("move_jp zero", *zero())


def psm_ratios(p: Player) -> None:
    def ratio(step: str, value: float, end: str = "") -> None:
        p.says(step, f"trajectory_j/set_ratio{end}", (value,))

    ratio("ratio .5", 0.5)
    p.move("move ratio .5", *zero(0.4))
    ratio("ratio 1", 1.0)
    ratio("ratio_v .3", 0.3, "_v")
    p.move("move ratio_v .3", *zero())
    ratio("ratio_v 1", 1.0, "_v")
    ratio("ratio_a .3", 0.3, "_a")
    p.move("move ratio_a .3", *zero(0.4))
    ratio("ratio 1b", 1.0)
    for value in (0.0, -1.0, 2.0, NAN):
        ratio(f"ratio {value}", value)
    ratio("ratio 1c", 1.0)
    p.move("move ratio restored", *zero())


def psm_sizes_and_limits(p: Player) -> None:
    robot, arm = p.robot, p.arm
    p.move("move_jp size 5", *zero(0.1)[:5])
    p.says("servo_jp size 5", "servo_jp", zero(0.1)[:5])
    p.move("move_jp size 7", *zero(0.1), 0.0)
    p.move("move_jp zero b", *zero())
    p.state("state foo", "foo")
    p.state("home when homed", "home")
    p.state("enable when homed", "enable")
    p.move("move_jp out of limits", *zero(3.0))
    p.move("move_jp zero c", *zero())
    p.says("move_jr out of limits", "move_jr", (3.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    p.move("move_jp zero d", *zero())
    p.says("move_cp far", "move_cp", p.tip(1.0))
    p.move("move_jp zero e", *zero())
    p.says("servo_cp far", "servo_cp", p.tip(1.0))
    robot.recover(arm)
    p.move("move_jp zero f", *zero())
    p.says("servo_jp jump .2", "servo_jp", zero(0.2))
    p.move("move_jp zero g", *zero())
    p.servo("servo_jp stream past limit", "servo_jp", lambda t: np.array(zero()) + [0, 0, 0.2 * t, 0, 0, 0], 1.5)
    p.move("move_jp zero h", *zero())
    start = p.tip()
    p.servo("servo_cp stream past limit", "servo_cp", lambda t: start + [0.2 * t, 0, 0, 0, 0, 0, 0], 1.5)
    p.move("move_jp zero i", *zero())
    p.says("move_cp not a rotation", "move_cp", 1.1 * p.tip())
    p.move("move_jp zero j", *zero())
    p.move("retract", 0.0, 0.0, 0.02, 0.0, 0.0, 0.0)
    p.says("move_cp not inserted", "move_cp", p.tip(0.002))
    p.says("servo_cp not inserted", "servo_cp", p.tip(0.002))
    p.move("move_jp zero k", *zero())


def psm_pauses(p: Player) -> None:
    p.broken("pause in a move", zero(0.4), 0.3, "state_command", text="pause")
    p.move("move_jp paused", *zero())
    p.state("resume", "resume")
    p.state("home after resume", "home")
    p.move("move_jp zero l", *zero())
    p.broken("disable in a move", zero(0.4), 0.3, "state_command", text="disable")
    p.state("resume disabled", "resume")
    p.state("home from disabled", "home")
    p.state("enable again", "enable")
    p.state("home again", "home")
    p.state("unhome", "unhome")
    p.state("home after unhome", "home")
    p.robot.recover(p.arm)
    p.move("move_jp zero m", *zero())


def psm_efforts_and_tools(p: Player) -> None:
    p.says("servo_jf 0", "servo_jf", (0.0,) * 6)
    p.says("body servo_cf 1N", "body/servo_cf", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    p.says("free", "free")
    p.says("hold 2", "hold")
    p.says("jaw servo_jf", "jaw/servo_jf", (0.0,))
    p.move("move_jp zero n", *zero())
    p.says("set_tool_type valid", "set_tool_type", text="PROGRASP_FORCEPS:400093")
    p.says("set_tool_type unknown", "set_tool_type", text="NO_SUCH_TOOL:1")
    p.says("emulate_tool_present 0", "emulate_tool_present", (0.0,))
    p.move("move_jp without tool", *zero(0.1))
    p.says("emulate_tool_present 1", "emulate_tool_present", (1.0,))
    p.move("move_jp end", *zero(0.1))


def psm_nan(p: Player) -> None:
    for step, command, values, after in (
            ("move_jp nan", "move_jp", zero(NAN), "move after move_jp nan"),
            ("servo_jp nan", "servo_jp", zero(NAN), "move after servo_jp nan"),
            ("move_jp inf", "move_jp", zero(math.inf), "move after inf"),
            ("servo_cp nan", "servo_cp", (NAN, *p.tip()[1:]), "move after servo_cp nan"),
            ("jaw move_jp nan", "jaw/move_jp", (NAN,), "move after jaw nan")):
        p.says(step, command, values)
        p.robot.recover(p.arm)
        p.move(after, *zero())


LEGS_MTM: Final = ((0.2, 0.2, 0.1, 0.3, 0.2, 0.1, 0.2), (0.0,) * 7, (-0.1, 0.1, -0.1, 0.5, -0.3, 0.2, 0.3))
LEGS_ECM: Final = ((0.2, 0.2, 0.1, 0.3), (-0.1, 0.1, 0.14, -0.2), (0.1, -0.1, 0.12, 0.1))


def legs(p: Player, joints: Sequence[Joints]) -> None:
    """To home, and there."""
    p.says("initial")
    p.state("enable", "enable")
    p.state("home", "home")
    for number, goal in enumerate(joints):
        p.move(f"move_jp {number}", *goal)


def mtm(robot: OriginalRobot) -> None:
    """One master."""
    p = Player(robot, "MTMR")
    legs(p, LEGS_MTM)
    p.says("move_cp", "move_cp", p.tip(0.01, -0.01, 0.01))
    p.servo_circle("servo_cp stream")
    p.move("move back", *LEGS_MTM[0])
    p.says("lock_orientation held", "lock_orientation", p.tip()[3:])
    p.says("body servo_cf 0", "body/servo_cf", (0.0,) * 6)
    p.says("lock_orientation free", "lock_orientation", p.tip()[3:])
    p.move("move_jp locked", *LEGS_MTM[1])
    p.says("unlock", "unlock_orientation")
    p.says("gravity comp", "use_gravity_compensation", (1.0,))
    p.says("body servo_cf 1N", "body/servo_cf", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    p.says("hold", "hold")
    p.move("move_jp after", *LEGS_MTM[0])
    p.says("gripper")
    p.state("disable", "disable")


def ecm(robot: OriginalRobot) -> None:
    """One ECM with a straight endoscope."""
    p = Player(robot, "ECM")
    legs(p, LEGS_ECM)
    p.says("move_cp", "move_cp", p.tip(*(0.05 * p.tip()[:3])))
    p.servo_circle("servo_cp stream")
    p.move("move back", *LEGS_ECM[0])
    p.says("set_endoscope_type", "set_endoscope_type", text="Classic_HD_UP")
    p.move("move_jp after endoscope", *LEGS_ECM[0])
    p.says("set_endoscope_type bad", "set_endoscope_type", text="NOPE")
    for command, after in (("move_cp", "move back 2"), ("servo_cp", "move back 3")):
        p.says(f"{command} unreachable orientation", command,
               p.tip(turn=rotation_from_vector(np.array([0.3, 0.0, 0.0]))))
        p.move(after, *LEGS_ECM[0])
    p.state("disable", "disable")


MTMR_TO: Final = (-0.1, 0.1, 0.1, 0.0, 0.4, -0.1, 0.0)
MTML_TO: Final = (0.1, 0.1, 0.1, 0.0, 0.4, 0.1, 0.0)


def teleop(robot: OriginalRobot) -> None:
    """Two masters, two PSMs, an ECM and a console."""
    def says(step: str, owner: str = "", command: str = "", *values: float, text: str = "", seconds: float = 0.3
             ) -> None:
        with robot.step(step, seconds):
            if owner:
                robot.ask(owner, command, values, text)

    def swings(step: str, *amplitude: float, seconds: float = 1.0) -> None:
        """The right master, by hand."""
        start, by = robot.joints("MTMR"), np.zeros(7)
        by[: len(amplitude)] = amplitude
        with robot.step(step, 0.3):
            robot.stream("MTMR", "servo_jp", lambda t: start + by * swing(t, seconds), seconds)

    says("initial")
    says("home", "system", "power_on")  # this step of the original ends before its homing begins
    for arm in ("MTML", "MTMR", "PSM1", "PSM2", "ECM"):
        robot.recover(arm)
    says("move PSM1", "PSM1", "move_jp", 0.1, -0.1, 0.14, 0.2, 0.2, -0.2)
    says("move PSM2", "PSM2", "move_jp", -0.1, -0.1, 0.14, 0.0, 0.1, 0.1)
    says("move MTMR", "MTMR", "move_jp", *MTMR_TO)
    says("move MTML", "MTML", "move_jp", *MTML_TO)
    says("operator present", "console", "emulate_operator_present", 1.0)
    says("teleop_enable", "console", "teleop_enable", 1.0, seconds=6.0)
    says("poses after start")
    swings("master translation", 0.1, 0.05, -0.05)
    swings("master rotation", 0.0, 0.0, 0.0, -0.2, 0.2, -0.1, 0.3)
    says("clutch press", "console", "emulate_clutch", 1.0)
    swings("master moves clutched", -0.1, 0.03, 0.02)
    says("clutch release", "console", "emulate_clutch", 0.0, seconds=2.0)
    swings("master after clutch", 0.05, 0.05, 0.03, 0.0, 0.1)
    says("set_scale .5", "MTMR_PSM1", "set_scale", 0.5)
    swings("master scale .5", -0.05, 0.03, 0.05, 0.0, 0.1)
    says("lock_rotation", "MTMR_PSM1", "lock_rotation", 1.0)
    swings("master rot locked", 0.03, 0.0, 0.0, -0.1, -0.1, 0.1, 0.2)
    says("unlock_rotation", "MTMR_PSM1", "lock_rotation", 0.0, seconds=2.0)
    says("lock_translation", "MTMR_PSM1", "lock_translation", 1.0)
    swings("master tr locked", 0.03, 0.0, 0.04, -0.1, 0.1, 0.1, 0.1)
    says("unlock_translation", "MTMR_PSM1", "lock_translation", 0.0)
    swings("master far (slave at limit)", -0.5, 0.0, 0.2, seconds=1.5)
    for end in ("", " b"):
        says(f"operator leaves{end}", "console", "emulate_operator_present", 0.0, seconds=1.0)
        if not end:
            says("operator back", "console", "emulate_operator_present", 1.0, seconds=1.0)
    says("back MTMR", "MTMR", "move_jp", *MTMR_TO)
    says("back MTML", "MTML", "move_jp", *MTML_TO)
    says("operator back b", "console", "emulate_operator_present", 1.0, seconds=3.0)
    says("camera press", "console", "emulate_camera", 1.0, seconds=1.5)
    says("ecm: both masters move", seconds=0.1)
    starts = {each: robot.joints(each) for each in MASTERS}
    with robot.step("ecm: masters moved"):
        for count in range(200):
            for each, by in MASTERS.items():
                robot.start(each, "servo_jp", starts[each] + np.append(by, np.zeros(4)) * swing(count / 200))
            robot.wait(1 / 200)
    says("camera release", "console", "emulate_camera", 0.0, seconds=3.0)
    says("teleop disable", "console", "teleop_enable", 0.0)
    says("unknown teleop", "console", "select_teleop", text="nope")
    says("state foo", "MTMR_PSM1", "state_command", text="foo")
    for value in (-1.0, 5.0, 0.2):
        says({-1.0: "set_scale -1", 5.0: "set_scale 5", 0.2: "set_scale .2"}[value], "MTMR_PSM1", "set_scale", value)
    says("power_off", "system", "power_off")


MASTERS: Final = {"MTML": (0.06, 0.06, 0.0), "MTMR": (0.06, 0.06, 0.0)}
