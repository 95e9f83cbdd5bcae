"""An arm on ROS: which of its messages are used, when it is there, and what makes it lost; on a fake clock."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from trocar.procs.document.bridges import RosArm
from trocar.procs.ros_messages.messages import (
    Bool,
    JointStates,
    MessageHeader,
    OperatingState,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    String,
    Time,
    Twist,
    TwistStamped,
    Vector3,
)
from trocar.tools.from_ros.remote_arm import TOPICS, Delays, RemoteArm

MS = 1_000_000
EPOCH_NS = 1_700_000_000_000_000_000
BY_NAME = {topic.name: topic for topic in TOPICS}
FAR = 20_000_000_000_000_000
"""As far as a stamp is from the time of day in simulated time."""


def time_of(ns: int) -> Time:
    return Time(*divmod(ns, 1_000_000_000))


class Publisher:
    """A PSM or another arm on ROS, which publishes a hundred times a second; `late_ns`: how long its messages take."""

    def __init__(self, kind: str = "PSM", **keys: Any) -> None:
        self.refused: list[str] = []
        self.arm = RemoteArm(RosArm("/PSM1", **keys), kind, self.refused.append)
        self.now_ns, self.number, self.late_ns, self.ahead_ns = 5_000 * MS, 1, 0, 0
        self.frame, self.x = "PSM1_base", 0.0

    @property
    def stamp_ns(self) -> int:
        return EPOCH_NS + self.now_ns + self.ahead_ns

    def header(self, stamp_ns: int | None = None, frame: str | None = None) -> MessageHeader:
        return MessageHeader(time_of(self.stamp_ns if stamp_ns is None else stamp_ns),
                             self.frame if frame is None else frame)

    def pose(self, stamp_ns: int | None = None, frame: str | None = None, w: float = 1.0) -> PoseStamped:
        return PoseStamped(self.header(stamp_ns, frame), Pose(Point(self.x, 0.0, -0.1), Quaternion(0.0, 0.0, 0.0, w)))

    def tell(self, topic: str, message: Any, publisher: int = 0) -> None:
        self.arm.take(BY_NAME[topic], message, publisher or self.number, self.now_ns,
                      EPOCH_NS + self.now_ns + self.late_ns)

    def run(self, seconds: float, **others: Any) -> None:
        """Poses, each after one message on the other topics (with _slash_ for /)."""
        for _ in range(round(seconds * 100)):
            self.step(**others)

    def step(self, **others: Any) -> None:
        self.now_ns += 10 * MS
        for topic, make in others.items():
            self.tell(topic.replace("_slash_", "/"), make())
        self.tell("measured_cp", self.pose())
        self.arm.look(self.now_ns)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.now_ns += 10 * MS
            self.arm.look(self.now_ns)


def there(kind: str = "PSM", **keys: Any) -> Publisher:
    made = Publisher(kind, **keys)
    made.run(0.7)
    assert made.arm.is_there and made.arm.is_valid and not made.arm.problem and not made.refused
    return made


def test_it_is_there_after_half_a_second_of_good_poses() -> None:
    made = Publisher()
    made.run(0.4)
    assert not made.arm.is_there
    made.run(0.2)
    assert made.arm.is_there and made.arm.frame == "PSM1_base" and made.arm.pose[2] == -0.1 and made.arm.losses == 0


def test_silence_is_a_loss_and_half_a_second_makes_it_good_again() -> None:
    made = there()
    made.wait(0.09)
    assert made.arm.is_there
    made.wait(0.03)
    assert not made.arm.is_there and made.arm.losses == 1 and "is silent" in made.arm.problem
    made.run(0.4)
    assert not made.arm.is_there
    made.run(0.2)
    assert made.arm.is_there and made.arm.losses == 1


def test_a_program_that_repeats_its_last_message_is_silent() -> None:
    made = there()
    stamp_ns = made.stamp_ns
    for jitter in range(15):  # as the ROS bridge converts it anew each time
        made.now_ns += 10 * MS
        made.tell("measured_cp", made.pose(stamp_ns + jitter * (-1) ** jitter * 50))
        made.arm.look(made.now_ns)
    assert made.arm.losses == 1 and not made.arm.is_there and not made.refused


def test_messages_that_waited_while_we_were_stalled_do_not_hide_a_silence() -> None:
    made = there()
    made.now_ns += 500 * MS
    made.tell("measured_cp", made.pose())
    assert made.arm.losses == 1 and not made.arm.is_there


def test_a_program_that_publishes_too_seldom_is_never_there() -> None:
    made = Publisher()
    for _ in range(40):
        made.wait(0.04)
        made.step()
    assert not made.arm.is_there and "comes every" in made.arm.problem and "needed is every 30 ms" in made.arm.problem


@pytest.mark.parametrize(
    ("wrong", "says"),
    [(lambda made: made.pose(w=math.nan), "must be finite"),
     (lambda made: made.pose(w=0.0), "quaternion has length 0"),
     (lambda made: made.pose(w=2.0), "quaternion has length 2"),
     (lambda made: made.pose(frame="ECM"), "its frame changed from 'PSM1_base' to 'ECM'"),
     (lambda made: made.pose(made.stamp_ns - 500 * MS), "out of order: sent 490 ms before the last message")],
)
def test_a_wrong_pose_is_refused_and_a_loss(wrong: Any, says: str) -> None:
    made = there()
    before = made.arm.pose.copy()
    made.now_ns += 10 * MS
    made.tell("measured_cp", wrong(made))
    assert made.arm.losses == 1 and not made.arm.is_there and not np.array_equal(made.arm.pose, before)
    (refused,) = made.refused
    assert refused.startswith("/PSM1/measured_cp: ") and says in refused and made.arm.problem == refused


def test_the_frame_of_a_lost_arm_may_be_another_one() -> None:
    made = there()
    made.frame = "ECM"
    made.step()
    assert made.arm.losses == 1
    made.run(0.7)
    assert made.arm.is_there and made.arm.frame == "ECM"


def test_two_programs_with_one_topic_are_both_refused() -> None:
    made = there()
    for _ in range(100):
        made.step()
        made.tell("measured_cp", made.pose(), publisher=2)
        made.arm.look(made.now_ns)
    assert made.arm.losses == 1 and not made.arm.is_there and "two programs publish it" in made.arm.problem


def test_a_successor_of_its_program_is_accepted_after_the_silence() -> None:
    made = there()
    made.wait(0.2)
    made.number = 2
    made.run(0.7)
    assert made.arm.is_there and not made.refused


def test_a_stamp_of_zero_is_a_pose_that_is_not_known() -> None:
    made = there()
    made.tell("measured_cp", made.pose(0))
    assert made.arm.is_there and not made.arm.is_valid and made.arm.losses == 0 and made.arm.news
    made.step()
    assert made.arm.is_valid


def test_messages_that_come_later_and_later_are_refused() -> None:
    made = there()
    for _ in range(11):  # never a silence
        made.late_ns += 10 * MS
        made.step()
    assert made.arm.losses == 1 and "110 ms late" in made.refused[0]


def test_clocks_of_two_machines_may_differ_and_drift() -> None:
    delays, ahead_ns = Delays(), 3_000 * MS
    for second in range(3600):
        ahead_ns -= MS // 5  # twice as much as bad clocks
        local_ns = EPOCH_NS + second * 1_000 * MS
        assert delays.late_ns(local_ns + ahead_ns, local_ns) < 30 * MS


def test_in_simulated_time_nothing_is_late() -> None:
    made = Publisher()
    made.ahead_ns = -FAR
    for _ in range(300):
        made.ahead_ns -= 5 * MS  # half as fast as real time
        made.step()
    assert made.arm.is_there and not made.refused


def test_values_beside_the_pose_are_known_while_they_come() -> None:
    made = Publisher()
    twist = Twist(Vector3(0.01, 0.0, 0.0), Vector3(0.0, 0.0, 0.1))
    made.run(0.7, setpoint_cp=made.pose, measured_cv=lambda: TwistStamped(made.header(), twist),
             jaw_slash_setpoint_js=lambda: JointStates(made.header(), ["jaw"], [0.5]),
             setpoint_js=lambda: JointStates(made.header(), ["a", "b"], [0.1, 0.2]))
    arm = made.arm
    assert not made.refused and arm.knew("setpoint_cp") and not arm.knew("gripper/measured_js")
    assert arm.value("jaw/setpoint_js") == [0.5] and arm.value("measured_cv")[5] == 0.1  # type: ignore[index]
    assert arm.value("setpoint_js").tolist() == [0.1, 0.2]  # type: ignore[union-attr]
    made.run(0.2)
    assert arm.value("jaw/setpoint_js") is None and arm.value("setpoint_cp") is None and arm.knew("setpoint_cp")
    assert arm.is_there


@pytest.mark.parametrize(
    ("topic", "names", "numbers", "says"),
    [("jaw/setpoint_js", ["grip"], [0.1], "no joint grip; its joints are: jaw"),
     ("jaw/setpoint_js", [], [0.1, 0.2], "2 positions instead of 1"),
     ("jaw/setpoint_js", [], [], "0 positions instead of 1"),
     ("jaw/setpoint_js", ["jaw"], [math.nan], "numbers must be finite"),
     ("setpoint_js", ["a", "a"], [0.1, 0.2], "2 positions of joints a, a"),
     ("setpoint_js", ["a"], [0.1, 0.2], "2 positions of joints a"),
     ("setpoint_js", [], [0.1] * 9, "9 positions instead of 1 to 8"),
     ("setpoint_js", [], [math.inf], "numbers must be finite")],
)
def test_wrong_joints_are_refused_and_their_value_is_unknown(topic: str, names: list[str], numbers: list[float],
                                                             says: str) -> None:
    made = there()
    good = JointStates(made.header(), [], [0.1])
    made.tell(topic, good)
    made.step()
    made.tell(topic, JointStates(made.header(), names, numbers))
    assert made.arm.value(topic) is None and made.arm.losses == 0
    (refused,) = made.refused
    assert refused == f"/PSM1/{topic}: {refused.partition(': ')[2]}" and says in refused


def test_joints_of_an_endoscope_are_put_in_order_by_their_names() -> None:
    made = there("ECM")
    names = ["outer_roll", "yaw", "pitch", "insertion"]
    made.tell("setpoint_js", JointStates(made.header(), names, [4.0, 1.0, 2.0, 3.0]))
    assert made.arm.value("setpoint_js").tolist() == [1.0, 2.0, 3.0, 4.0]  # type: ignore[union-attr]
    made.step()
    made.tell("setpoint_js", JointStates(made.header(), ["pan", *names[1:]], [4.0, 1.0, 2.0, 3.0]))
    assert made.arm.value("setpoint_js") is None and "no joint pan" in made.refused[0]


def test_names_do_not_count_where_the_file_says_so() -> None:
    made = there(check_names=False)
    made.tell("jaw/setpoint_js", JointStates(made.header(), ["tool_jaw"], [0.1]))
    assert made.arm.value("jaw/setpoint_js") == [0.1]


def test_a_setpoint_in_another_frame_is_refused() -> None:
    made = there()
    for frame in ("ECM", ""):
        made.step()
        made.tell("setpoint_cp", made.pose(frame=frame))
        assert made.arm.value("setpoint_cp") is None
    assert len(made.refused) == 2 and "its frame is 'ECM', that of measured_cp 'PSM1_base'" in made.refused[0]
    made.step()
    made.tell("measured_cv", TwistStamped(made.header(frame=""), Twist()))
    assert made.arm.value("measured_cv") is not None, "a twist may have no frame"


def test_an_unknown_state_is_refused_and_no_state() -> None:
    made = there()
    made.tell("operating_state", OperatingState(made.header(), "ENABLED", is_homed=True))
    assert made.arm.state == "ENABLED" and made.arm.is_homed
    made.step()
    made.tell("operating_state", OperatingState(made.header(), "TELEOP"))
    assert made.arm.state == "" and "'TELEOP' is no state" in made.refused[0]


def test_a_latched_state_that_comes_late_or_twice_changes_nothing() -> None:
    made = there()
    older = OperatingState(made.header(), "DISABLED")
    made.step()
    newer = OperatingState(made.header(), "ENABLED", is_homed=True)
    made.run(5.0)
    for message in (newer, newer, older):
        made.tell("operating_state", message)
        assert made.arm.state == "ENABLED"
    assert not made.refused


def test_its_state_outlives_a_silence_as_it_is_published_on_change_only() -> None:
    made = there()
    made.tell("operating_state", OperatingState(made.header(), "ENABLED", is_homed=True))
    made.tell("tool_type", String("LARGE_NEEDLE_DRIVER"))
    made.wait(0.5)
    made.run(0.7)
    assert made.arm.is_there and made.arm.state == "ENABLED" and made.arm.tool == "LARGE_NEEDLE_DRIVER"


def test_the_end_of_a_move_is_a_message_without_a_stamp() -> None:
    made = there()
    assert made.arm.goal_reached is None
    made.tell("goal_reached", Bool(True))
    assert made.arm.goal_reached is True
