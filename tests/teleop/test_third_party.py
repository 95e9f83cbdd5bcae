"""A master that is a program of somebody else: what a teleoperation believes of it; on a fake clock."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.teleop.harness import EcmHarness, FakeTeleopArm, FakeTeleopRing, TeleopHarness
from trocar.procs.node.inputs import Input
from trocar.procs.teleop.arms import TeleopArm
from trocar.procs.teleop.motion_check import STEP_RAD
from trocar.procs.teleop.third_party import ThirdPartyArm
from trocar.shm.mailbox.origins import NO_ORIGIN
from trocar.shm.operator_topics import THIRD_PARTY_STATE

RECORD_NS = 10_000_000  # a hundred records a second


class Program(FakeTeleopArm):
    """Somebody's program: it carries nothing out."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.ring, self.obeys = FakeTeleopRing(THIRD_PARTY_STATE, inputs=0), False
        self.ring.set(state=b"ENABLED", is_homed=True, reference_valid=True, gripper_valid=True, simulated=True)
        self.pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

    def seen(self, *, is_master: bool = False) -> TeleopArm:
        self.origin = NO_ORIGIN
        return ThirdPartyArm(self.name, Input(self.ring), self.events, self)


class ThirdPartyStage(TeleopHarness):
    """Ten cycles for one record of the master."""

    def __init__(self) -> None:
        super().__init__(start_gripper_threshold=0.5, mtm_is_haptic=False, align_mtm=False)

    def start(self, left: FakeTeleopRing | None = None) -> None:
        self.arms["MTMR"] = Program("MTMR")
        self.arms["MTMR"].ring.stamp_ns = self.now_ns
        super().start(left)

    def step(self, *requests: object) -> None:
        master = self.arms["MTMR"]
        stamp, alive = master.ring.stamp_ns, master.alive
        super().step(*requests)  # type: ignore[arg-type]
        if alive and self.now_ns - stamp < RECORD_NS:
            master.ring.stamp_ns = stamp


@pytest.fixture
def stage() -> ThirdPartyStage:
    stage = ThirdPartyStage()
    stage.arms["MTMR"].ring.stamp_ns = 0
    stage.run(0.02)
    stage.state_command("enable")
    show_presence(stage)
    assert stage.following, stage.text("reason")
    stage.forget()
    return stage


def show_presence(stage: ThirdPartyStage) -> None:
    for gripper in (0.0, 1.0, 0.0):
        stage.master.ring.set(gripper_position=gripper)
        stage.run(0.02)


def test_a_master_without_forces_is_followed_and_asked_for_nothing(stage: ThirdPartyStage) -> None:
    before = stage.slave.pose
    for _ in range(20):
        stage.master.shift(0.005, 0.0, 0.0)
        stage.run(0.01)
    assert stage.following and stage.slave.pose[0] - before[0] == pytest.approx(0.02)
    assert stage.master.sent == []


@pytest.mark.parametrize("turn", [False, True])
def test_a_jump_ends_following_until_it_is_steady_and_presence_is_shown(stage: ThirdPartyStage, turn: bool) -> None:
    before = stage.slave.pose
    if turn:
        stage.master.turn(2, math.radians(60))
    else:
        stage.master.shift(0.1, 0.0, 0.0)
    stage.run(0.02)
    assert not stage.following and np.array_equal(stage.slave.pose, before)
    assert stage.slave.words()[-1] == "end_stream"
    (reported,) = stage.reports.of("error")
    assert reported.startswith("MTMR_PSM1: MTMR jumped by " + ("60°" if turn else "100 mm"))
    assert reported.removeprefix("MTMR_PSM1: ") in stage.text("reason")
    show_presence(stage)
    assert not stage.following, "it is not believed so soon"
    stage.run(0.5)
    assert not stage.following, "presence counts from when it is believed"
    show_presence(stage)
    assert stage.following and np.allclose(stage.slave.pose, before), "from where it is now, without a jump"


def test_a_master_that_jumps_all_the_time_is_told_once(stage: ThirdPartyStage) -> None:
    for place in range(100):
        stage.master.shift(0.1 * (-1) ** place, 0.0, 0.0)
        stage.run(0.01)
    assert not stage.following and len(stage.reports.of("error")) == 1


@pytest.mark.parametrize(
    ("wrong", "reported"),
    [({"measured_cp": (math.nan, 0, 0, 0, 0, 0, 1)}, "MTMR reports an invalid pose"),
     ({"measured_cp": (0, 0, 0, 0, 0, 0, 0)}, "MTMR reports an invalid pose"),
     ({"measured_cp": (0, 0, 0, 0, 0, 0, 2)}, "MTMR reports an invalid pose"),
     ({"setpoint_cp": (math.inf, 0, 0, 0, 0, 0, 1)}, "MTMR reports an invalid pose"),
     ({"measured_cv": (math.nan, 0, 0, 0, 0, 0)}, "MTMR reports a speed of nan m/s"),
     ({"measured_cv": (50.0, 0, 0, 0, 0, 0)}, "MTMR reports a speed of 50 m/s"),  # mm/s?
     ({"gripper_position": math.nan}, "MTMR reports an invalid gripper angle"),
     ({"gripper_valid": False}, "MTMR has lost its gripper")],
)
def test_nonsense_ends_following(stage: ThirdPartyStage, wrong: dict[str, object], reported: str) -> None:
    before = stage.slave.pose
    stage.master.ring.set(**wrong)
    stage.run(0.02)
    assert not stage.following and reported in stage.reports.of("error")[0]
    assert np.isfinite(stage.slave.pose).all() and np.array_equal(stage.slave.pose, before)
    assert len(stage.reports.of("error")) == 1


def test_a_master_that_does_not_know_where_it_is_is_left(stage: ThirdPartyStage) -> None:
    stage.master.ring.set(reference_valid=False)
    stage.run(0.02)
    assert stage.text("state") == "DISABLED"
    assert stage.text("reason") == "the pose of MTMR in its reference frame is not known"


class Carriers(EcmHarness):
    """Two programs that carry the camera."""

    def start(self, left: FakeTeleopRing | None = None) -> None:
        self.arms |= {name: Program(name) for name in ("MTML", "MTMR")}
        super().start(left)


def test_two_programs_carry_a_camera_and_are_not_pushed() -> None:
    stage = Carriers()
    stage.follow()
    for _ in range(20):
        for name in ("MTML", "MTMR"):
            stage.arms[name].shift(0.001, 0.0, 0.0)
        stage.step()
    assert stage.following and stage.slave.ring.field("setpoint_position")[0] == pytest.approx(-0.05, abs=1e-3)
    assert not stage.arms["MTML"].asked("body/servo_cf")
    stage.arms["MTMR"].shift(0.1, 0.0, 0.0)
    stage.step()
    assert not stage.following and "MTMR jumped by 100 mm" in stage.reports.of("error")[0]


def test_stamps_from_the_future_are_silence(stage: ThirdPartyStage) -> None:
    stage.master.alive = False
    stage.master.ring.stamp_ns = stage.now_ns + 10**12
    stage.run(0.05)
    assert not stage.following and stage.reports.of("error") == ["MTMR_PSM1: MTMR is silent"]


def test_a_program_that_died_and_is_back_needs_presence(stage: ThirdPartyStage) -> None:
    stage.master.alive = False
    stage.run(0.045)
    assert not stage.following and stage.text("reason") == "waiting: MTMR is silent"
    stage.master.ring.epoch += 1
    stage.master.shift(0.3, 0.0, 0.0)  # it may be anywhere
    stage.master.alive = True
    stage.run(0.1)
    assert not stage.following
    before = stage.slave.pose
    show_presence(stage)
    assert stage.following and np.allclose(stage.slave.pose, before)


def test_records_that_were_held_up_are_no_jump(stage: ThirdPartyStage) -> None:
    """25 mm within 25 ms: two records did not come, but none was silent."""
    stage.master.alive = False
    stage.run(0.02)
    stage.master.alive = True
    stage.master.shift(0.025, 0.0, 0.0)
    stage.run(0.02)
    assert stage.following, stage.text("reason")


def test_a_master_that_creeps_away_in_small_jumps_is_not_followed(stage: ThirdPartyStage) -> None:
    for _ in range(5):  # 6 m/s, each step within what a coarse device may show
        stage.master.shift(0.006, 0.0, 0.0)
        stage.step()
    assert not stage.following and any("jumped by 6 mm" in text for text in stage.reports.of("error"))


def test_a_master_that_turns_away_in_small_jumps_is_not_followed(stage: ThirdPartyStage) -> None:
    for _ in range(5):
        stage.master.turn(2, 0.6 * STEP_RAD)
        stage.step()
    assert not stage.following and any("a hand turns at" in text for text in stage.reports.of("error"))


def test_a_jaw_that_is_no_number_is_none() -> None:
    harness = TeleopHarness(start_gripper_threshold=0.5)
    slave = harness.arms["PSM1"] = Program("PSM1")
    slave.ring.set(has_jaw=True, jaw_setpoint_position=math.nan)
    harness.start()
    harness.run(0.02)
    harness.state_command("enable")
    harness.run(0.02)
    assert harness.text("state") == "DISABLED" and "PSM1 has no jaw" in harness.text("reason")
