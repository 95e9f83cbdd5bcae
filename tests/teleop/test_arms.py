"""One arm as a teleoperation sees it: answers in any order, limits that pass, bases and what is not believed."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import numpy as np
import pytest

from tests.teleop.harness import Answer, FakeTeleopArm, FakeTeleopRing
from trocar.procs.node.inputs import Input
from trocar.procs.teleop.arms import LIMIT_SHOWN_NS, MAX_GOALS, SHOWN_NS, BaseFrame, TeleopArm
from trocar.procs.teleop.motion_check import MAX_M_S, MAX_RAD_S, MAX_STEP_NS, STEADY_NS, STEP_M, STEP_RAD
from trocar.procs.teleop.third_party import UNIT, ThirdPartyArm
from trocar.shm.operator_topics import THIRD_PARTY_STATE
from trocar.shm.topics import ARM_STATE, SUJ_STATE

MS = 1_000_000
HERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class Watched:
    """An arm that is looked at, and answers what a test says."""

    def __init__(self) -> None:
        self.fake, self.now_ns = FakeTeleopArm("PSM1"), 10_000 * MS
        self.fake.send = self.note  # type: ignore[method-assign]
        self.number, self.full = 0, False
        self.arm = self.made()
        self.look()

    def made(self) -> TeleopArm:
        return self.fake.seen()

    def note(self, name: str, values: Any = (), text: str = "") -> int:
        self.fake.sent.append((name, tuple(values), text))
        self.number += not self.full
        return 0 if self.full else self.number

    def look(self, *answers: Answer, after_ms: float = 1.0, written: bool = True) -> None:
        self.now_ns += round(after_ms * MS)
        if written:
            self.fake.ring.stamp_ns = self.now_ns
        self.fake.answers += answers
        self.arm.look(self.now_ns)


def test_an_arm_that_is_not_there_yet_is_none() -> None:
    fake = FakeTeleopArm("PSM1")
    arm = fake.seen()
    arm.look(5)
    assert arm.is_silent and not (arm.whole or arm.is_ready or arm.is_busy or arm.has_pose or arm.is_in_hand)
    assert (arm.refusal, arm.limit, arm.fault, arm.doubt, arm.errors()) == ("", "", "", "", [])


def test_a_move_is_over_when_its_own_answer_says_so() -> None:
    watched = Watched()
    arm = watched.arm
    arm.send("hold")
    arm.move(np.zeros(7))
    assert arm.is_moving and arm.is_busy and not arm.has_arrived
    arm.send("hold")
    for number in (1, 3):
        watched.look(Answer(number, "done"))
        assert arm.is_moving and not arm.has_arrived
    watched.look(Answer(2, "accepted"))
    assert arm.is_moving and not arm.has_arrived
    watched.look(Answer(2, "done"))
    assert not arm.is_moving and arm.has_arrived
    for outcome in ("failed", "refused"):
        arm.move(np.zeros(7))
        watched.look(Answer(watched.number, outcome, "why"))
        assert not arm.is_moving and not arm.has_arrived
    watched.full = True
    arm.move(np.zeros(7))
    assert not arm.is_moving, "there was no room for it"


def test_a_move_ends_with_the_process_that_made_it() -> None:
    watched = Watched()
    watched.arm.move(np.zeros(7))
    watched.look(Answer(watched.number, "done"))
    watched.arm.move(np.zeros(7))
    watched.fake.ring.epoch += 1
    watched.look()
    assert watched.arm.restarted and not watched.arm.is_moving and not watched.arm.has_arrived
    watched.look()
    assert not watched.arm.restarted


def test_goals_are_refused_until_one_is_taken() -> None:
    watched, chance = Watched(), Random(1)
    expected, waiting = False, list[int]()
    for _ in range(300):
        if chance.random() < 0.5:
            waiting.append(watched.arm.pursue("servo_cp", np.zeros(7)))
        else:
            watched.arm.send("hold")
        if waiting and chance.random() < 0.6:
            number = waiting.pop(0)
            outcome = chance.choice(("done", "accepted", "refused", "failed"))
            watched.look(Answer(number, outcome))
            expected = outcome in ("refused", "failed")
            watched.look(Answer(number, "refused" if outcome == "done" else "done"))  # it was answered already
        else:
            watched.look(Answer(watched.number + 7, "refused"))
        assert watched.arm.refuses_goals is expected
    watched.full = True
    assert watched.arm.pursue("servo_cp", np.zeros(7)) == 0


def test_goals_whose_answers_were_lost_are_forgotten_together() -> None:
    watched = Watched()
    numbers = [watched.arm.pursue("servo_cp", np.zeros(7)) for _ in range(MAX_GOALS + 1)]
    watched.look(Answer(numbers[-2], "refused"))
    assert not watched.arm.refuses_goals, "forgotten"
    watched.look(Answer(numbers[-1], "refused"))
    assert watched.arm.refuses_goals
    again = Watched()
    numbers = [again.arm.pursue("servo_cp", np.zeros(7)) for _ in range(MAX_GOALS)]
    again.look(Answer(numbers[0], "refused"))
    assert again.arm.refuses_goals, "so many are kept"


def test_refusals_are_shown_for_a_second_and_limits_for_a_tenth() -> None:
    for lasts_ns, answer, name, text in (
            (SHOWN_NS, Answer(3, "refused", "no"), "refusal", "PSM1: no"),
            (SHOWN_NS, Answer(3, "failed", "no"), "refusal", "PSM1: no"),
            (LIMIT_SHOWN_NS, Answer(3, "done", "at its limit: yaw"), "limit", "PSM1 at its limit: yaw"),
            (LIMIT_SHOWN_NS, Answer(3, "done", "clipped: yaw, jaw"), "limit", "PSM1 at its limit: yaw, jaw")):
        watched = Watched()
        watched.look(answer)
        assert getattr(watched.arm, name) == text
        watched.look(after_ms=lasts_ns / MS - 1e-6)
        assert getattr(watched.arm, name) == text
        watched.look(after_ms=1e-6)
        assert getattr(watched.arm, name) == ""
    for quiet in ("clipped: jaw", "at its limit: jaw", "hm: yaw", "clipped", ""):
        watched = Watched()
        watched.look(Answer(3, "done", quiet))
        assert watched.arm.limit == watched.arm.refusal == "" or quiet == "clipped"


def test_a_model_of_its_weight_that_an_arm_has_not_is_no_refusal() -> None:
    watched = Watched()
    watched.arm.let_go()
    weight = watched.number - 1
    watched.look(Answer(weight, "refused", "no model"))
    assert watched.arm.refusal == ""
    watched.look(Answer(weight, "refused", "why"))
    assert watched.arm.refusal == "PSM1: why", "that number was answered"
    assert watched.fake.sent == [("use_gravity_compensation", (1.0,), ""), ("body/servo_cf", (0.0,) * 6, "")]


@pytest.mark.parametrize("state", [{"state": b"DISABLED"}, {"is_homed": False}, None])
def test_only_an_arm_that_is_ready_is_let_go(state: dict[str, Any] | None) -> None:
    watched = Watched()
    watched.fake.ring.set(**(state or {}))
    watched.look(written=state is not None, after_ms=1.0 if state else 31.0)
    watched.arm.let_go()
    assert watched.fake.sent == []


def test_every_stop_is_another_programs_and_named_once() -> None:
    watched = Watched()
    watched.look()
    assert watched.arm.stopped_by == ""
    watched.fake.stop("plan.py")
    watched.look()
    assert watched.arm.stopped_by == "plan.py (hold)"
    watched.look()
    assert watched.arm.stopped_by == ""
    watched.fake.stop("plan.py")
    watched.fake.ring.torn = True
    watched.look()
    assert watched.arm.stopped_by == ""
    watched.fake.ring.torn = False
    watched.look()
    assert watched.arm.stopped_by == "plan.py (hold)"
    watched.fake.ring.epoch += 1
    watched.fake.ring.set(stops=0)
    watched.look()
    assert watched.arm.stopped_by == "", "its process counts anew"


@pytest.mark.parametrize("mode", [1, 2])
def test_an_arm_that_was_let_go_and_holds_again_is_taken(mode: int) -> None:
    watched = Watched()
    watched.arm.let_go()
    watched.look()
    assert not watched.arm.is_taken, "it was not let go yet"
    watched.fake.ring.set(control_mode=3)
    watched.look()
    assert not watched.arm.is_taken
    watched.fake.ring.set(control_mode=mode)
    watched.look()
    assert watched.arm.is_taken
    watched.arm.let_go()
    watched.look()
    assert not watched.arm.is_taken


@pytest.mark.parametrize(("base", "rebased"), [
    ((0.003, 0.0, 0.004, *HERE[3:]), False), ((0.0, 0.00501, 0.0, *HERE[3:]), True),
    ((0.0, 0.0, 0.0, 0.0, 0.0, math.sin(0.0499), math.cos(0.0499)), False),
    ((0.0, 0.0, 0.0, 0.0, 0.0, math.sin(0.0501), math.cos(0.0501)), True), ((math.nan, *HERE[1:]), True)])
def test_a_base_that_goes_further_than_a_step_is_another(base: tuple[float, ...], rebased: bool) -> None:
    watched = Watched()
    assert not watched.arm.rebased, "the first is none other"
    watched.fake.ring.set(base_frame=base)
    watched.look()
    assert watched.arm.rebased is rebased
    watched.look()
    assert not watched.arm.rebased, "it is the one it was"


def test_a_torn_record_leaves_what_was_known() -> None:
    watched = Watched()
    watched.fake.ring.set(sub_state=b"MANUAL", is_busy=True, measured_cp=(0.1, *HERE[1:]))
    watched.fake.ring.torn = True
    watched.look()
    assert not watched.arm.whole and not watched.arm.is_in_hand and not watched.arm.is_busy
    assert watched.arm.measured[0] == 0.0
    watched.fake.ring.torn = False
    watched.look()
    assert watched.arm.is_in_hand and watched.arm.is_busy and watched.arm.measured[0] == 0.1
    watched.fake.ring.set(setpoint_cp=(math.inf, *HERE[1:]), measured_cp=(0.2, *HERE[1:]))
    watched.look()
    assert not watched.arm.has_pose and watched.arm.measured[0] == 0.1, "the last that was known"


def test_base_frames_are_known_while_their_record_is() -> None:
    for topic, setup in ((ARM_STATE, None), (SUJ_STATE, 1)):
        ring = FakeTeleopRing(topic, **({} if setup is None else {"setups": 3}))
        base = BaseFrame("ECM", Input(ring), setup)  # type: ignore[arg-type]
        pose, known = (ring.field("measured_cp"), ring.field("reference_valid")) if setup is None else (
            ring.field("measured_cp")[setup], ring.field("base_valid")[setup:])
        base.look(5 * MS)
        assert base.pose is None, "there is no record"
        pose[...], ring.stamp_ns = (0.1, *HERE[1:]), 5 * MS
        base.look(5 * MS)
        assert base.pose is None
        known[...] = True
        base.look(5 * MS)
        assert base.pose is not None and base.pose[0] == 0.1
        pose[1] = math.nan
        base.look(5 * MS)
        assert base.pose is None
        pose[1] = 0.0
        base.look(35 * MS)
        assert base.pose is not None
        base.look(35 * MS + 1)
        assert base.pose is None, "it is too old"


# -- third-party programs ----------------------------------------------------------------------------------------------


class LoneProgram(Watched):
    """A third-party program."""

    def __init__(self) -> None:
        super().__init__()
        self.arm.errors()

    def made(self) -> TeleopArm:
        self.fake.ring = FakeTeleopRing(THIRD_PARTY_STATE, inputs=0)
        self.fake.ring.set(state=b"ENABLED", is_homed=True, reference_valid=True, gripper_valid=True)
        self.fake.pose = HERE
        return ThirdPartyArm("MTMR", Input(self.fake.ring), self.fake.events, self.fake)  # type: ignore[arg-type]

    def go(self, metres: float, angle: float, after_ms: float = 10.0, **changes: Any) -> str:
        """Written so far and turned so far from there; the fault."""
        self.fake.shift(metres, 0, 0)
        self.fake.turn(2, angle)
        self.fake.ring.set(**changes)
        self.look(after_ms=after_ms)
        return self.arm.fault


@pytest.mark.parametrize("after_ms", [1.0, 10.0, 30.0])
def test_a_step_may_be_as_long_as_a_hand_goes_in_that_time(after_ms: float) -> None:
    way, turn = MAX_M_S * after_ms * 1e-3 + STEP_M, MAX_RAD_S * after_ms * 1e-3 + STEP_RAD
    for metres, angle, what in ((way - 1e-6, 0.0, ""), (way + 1e-6, 0.0, "MTMR jumped by"), (0.0, turn - 1e-6, ""),
                                (0.0, turn + 1e-6, "°; a hand turns at 30 rad/s")):
        program = LoneProgram()
        assert what in program.go(metres, angle, after_ms) and bool(program.arm.fault) is bool(what)
    late = LoneProgram()
    assert late.go(MAX_M_S * MAX_STEP_NS * 1e-9 + STEP_M + 1e-6, 0.0, 25.0 + after_ms) or after_ms < 5.0


def test_what_a_step_may_have_on_top_is_used_up_and_comes_back() -> None:
    program = LoneProgram()
    way = MAX_M_S * 0.010
    assert not program.go(way + 0.6 * STEP_M, 0.0) and program.go(way + 0.6 * STEP_M, 0.0)
    program = LoneProgram()
    assert not program.go(way + 0.6 * STEP_M, 0.0) and not program.go(0.0, 0.0) and not program.go(way + STEP_M, 0.0)
    turn = MAX_RAD_S * 0.010
    program = LoneProgram()
    assert not program.go(0.0, turn + 0.6 * STEP_RAD) and program.go(0.0, turn + 0.6 * STEP_RAD)


def test_a_twist_is_too_fast_beyond_what_a_hand_does() -> None:
    for linear, angular, wrong in ((MAX_M_S, 0.0, ""), (MAX_M_S + 1e-6, 0.0, "2 m/s, 0 rad/s"),
                                   (0.0, MAX_RAD_S, ""), (0.0, MAX_RAD_S + 1e-5, "0 m/s, 30 rad/s"),
                                   (math.nan, 0.0, "nan m/s"), (0.0, math.nan, "nan rad/s")):
        for axis in range(3):
            twist = np.zeros(6)
            twist[axis], twist[3 + axis] = linear, angular
            fault = LoneProgram().go(0.0, 0.0, measured_cv=twist)
            assert wrong in fault and bool(fault) is bool(wrong)


@pytest.mark.parametrize("which", ["measured_cp", "setpoint_cp"])
def test_a_pose_has_a_place_and_a_quaternion_of_length_1(which: str) -> None:
    for pose, wrong in (((*HERE[:6], 1.0 + 0.99 * UNIT), False), ((*HERE[:6], 1.0 - 0.99 * UNIT), False),
                        ((*HERE[:6], 1.0 + 1.01 * UNIT), True), ((*HERE[:6], 1.0 - 1.01 * UNIT), True),
                        ((*HERE[:5], 0.1, 1.0), True), ((math.nan, *HERE[1:]), True),
                        ((0, 0, math.inf, *HERE[3:]), True), ((*HERE[:3], math.nan, *HERE[4:]), True)):
        program = LoneProgram()
        program.fake.ring.set(**{which: pose})
        program.look()
        assert bool(program.arm.fault) is wrong
        program.look()
        assert program.arm.fault == "", "it is said once"
        assert program.arm.doubt == ("MTMR reports an invalid pose" if wrong else "")


def test_a_gripper_that_was_there_is_missed() -> None:
    program = LoneProgram()
    assert program.go(0.0, 0.0, gripper_valid=False) == "MTMR has lost its gripper"
    program = LoneProgram()
    assert program.go(0.0, 0.0, gripper_position=math.nan) == "MTMR reports an invalid gripper angle"
    assert not LoneProgram().go(0.0, 0.0, gripper_position=0.5)


def test_it_is_believed_again_after_half_a_second_without_a_fault() -> None:
    program = LoneProgram()
    assert program.go(1.0, 0.0) and program.arm.doubt and not program.arm.has_pose
    program.look(after_ms=200.0)
    assert program.go(1.0, 0.0) == "", "it is doubted already"
    for _ in range(49):
        program.look(after_ms=STEADY_NS / MS / 50)
        assert program.arm.doubt and not program.arm.has_pose
    program.look(after_ms=STEADY_NS / MS / 50)
    assert not program.arm.doubt and program.arm.has_pose
    assert program.go(1.0, 0.0), "and said again"


def test_a_pose_that_was_not_known_is_compared_with_nothing() -> None:
    for changes in ({"reference_valid": False}, {"measured_cp": (math.nan, *HERE[1:])}):
        program = LoneProgram()
        program.fake.ring.set(**changes)
        program.look()
        program.fake.ring.set(reference_valid=True)
        program.fake.pose = (0.5, *HERE[1:])
        program.look()
        assert program.arm.fault == ""
    program.look(after_ms=STEADY_NS / MS - 2.0)
    assert program.arm.doubt
    program.look(after_ms=1.0)
    assert not program.arm.doubt, "where it came back was no jump"
    program = LoneProgram()
    program.fake.ring.epoch += 1
    assert program.go(0.5, 0.0) == "", "it was started again"


def test_a_record_that_was_seen_is_not_judged_again() -> None:
    program = LoneProgram()
    program.fake.shift(0.5, 0, 0)
    program.look(written=False)
    assert program.arm.fault == "" and program.go(0.0, 0.0)
