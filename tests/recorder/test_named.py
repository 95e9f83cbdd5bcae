"""Recordings that people ask for: every record of what they chose, and what is missing is counted."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
import yaml

from tests.recorder.harness import RingsOfATest
from trocar.procs.recordings import names
from trocar.procs.recordings.reading import open_recording
from trocar.shm.system.subscriptions import Subscriptions
from trocar.shm.time.control_page import ControlPage
from trocar.tools.analysis.choosing import Stretch
from trocar.tools.analysis.rosbag import to_rosbag2


def recorded(rings: RingsOfATest, *topics: str, steps: int = 20, each: int = 30) -> list:
    named = rings.named(*topics)
    for n in range(steps):
        rings.write(each)
        rings.events.emit("goal_reached", value=float(n))
        rings.passes(n * 0.05)
        named.step()
    named.end()
    rings.written()
    return [named, open_recording(named.file.path)]


def test_every_record_of_a_chosen_topic_is_in_it(rings: RingsOfATest) -> None:
    named, recording = recorded(rings, "PSM1/state")
    with recording:
        found = recording.records("PSM1/state")
        assert found.rows["sequence"].tolist() == list(range(1, 601))
        assert found.missing == named.lost == 0
        assert len(recording.records("PSM1/setpoint").rows) == 0
        assert len(recording.events()) == 20
        assert recording.metadata[names.LOSSES]["PSM1/state"] == "0"
        assert 10 <= len(list(recording.messages("PSM1/measured_js"))) <= 30  # some, for tools that know no records


@pytest.mark.parametrize("topics", [(), ("PSM1/state",)])
def test_dvrk_s_bag_replay_finds_its_topics(rings: RingsOfATest, tmp_path: Path, topics: tuple[str, ...]) -> None:
    _, recording = recorded(rings, *topics, steps=5)
    bag = tmp_path / "bag"
    bag.mkdir()
    with recording:
        to_rosbag2(recording, bag, recording.topics, Stretch(), lambda text, fraction: None)
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    types = {row["topic_metadata"]["name"]: row["topic_metadata"]["type"]
             for row in about["topics_with_message_count"] if row["message_count"]}
    joints, pose = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped"
    expected = {"/PSM1/setpoint_js": joints, "/PSM1/jaw/setpoint_js": joints, "/PSM1/setpoint_cp": pose,
                "/PSM1/local/setpoint_cp": pose}
    assert expected.items() <= types.items()


def test_a_chosen_view_is_told_of_every_record(rings: RingsOfATest) -> None:
    _, recording = recorded(rings, "PSM1/measured_js", steps=5)
    with recording:
        assert len(list(recording.messages("PSM1/measured_js"))) == 150
        assert len(recording.records("PSM1/state").rows) == 150


@pytest.mark.slow
def test_an_instance_means_all_that_it_writes(rings: RingsOfATest) -> None:
    named, recording = recorded(rings, "PSM1", steps=3)
    with recording:
        assert {"PSM1/state", "PSM1/setpoint"} <= set(named.topics)
        assert len(recording.records("PSM1/setpoint").rows) == 90


def test_without_topics_all_arms_are_taken_and_users_are_not(rings: RingsOfATest) -> None:
    named, recording = recorded(rings, steps=3)
    with recording:
        assert {"PSM1/state", "PSM1/setpoint"} <= set(named.topics)
        assert "box/state" not in named.topics


def test_records_that_were_overwritten_are_counted_as_lost(rings: RingsOfATest) -> None:
    named = rings.named("box/state")
    for n in range(100):  # the ring keeps twenty
        rings.slow.field("number")[...] = n
        rings.slow.publish(n + 1)
    rings.passes()
    named.step()
    named.end()
    rings.written()
    with open_recording(named.file.path) as recording:
        found = recording.records("box/state")
        assert named.lost == 100 - len(found.rows) > 70
        assert recording.metadata[names.LOSSES]["box/state"] == str(named.lost)


def test_a_topic_that_is_not_there_is_refused_by_name(rings: RingsOfATest) -> None:
    with pytest.raises(ValueError, match="no topic PSM9/state"):
        rings.named("PSM9/state")


def test_it_ends_when_its_time_is_over_on_the_system_s_clock(rings: RingsOfATest) -> None:
    named, begin_ns = rings.named("PSM1/state", seconds=3.0), rings.times.system_ns
    rings.passes(10.0)
    rings.times.system_ns = begin_ns + 2_000_000_000
    assert not named.is_over and named.passed_s == 2.0
    rings.times.system_ns = begin_ns + 3_500_000_000
    assert named.is_over


def test_channels_do_not_grow_with_the_number_of_recordings(rings: RingsOfATest) -> None:
    rings.named("PSM1/measured_js", "PSM1/state").close()
    before = len(rings.table.channels)
    for _ in range(5):
        rings.named("PSM1/measured_js", "PSM1/state").close()
    assert len(rings.table.channels) == before


def test_what_is_written_seldom_is_in_it_as_it_was_at_the_beginning(rings: RingsOfATest) -> None:
    for number in (1.0, 2.0):
        rings.seldom.field("number")[...] = number
        rings.seldom.publish(5)
    began_ns = rings.times.local_ns
    _, recording = recorded(rings, "PSM1/state", steps=2)
    with recording:
        gains = recording.records("box/gains")
        assert gains.rows["number"].tolist() == [2.0] and gains.rows["stamp_ns"].tolist() == [5]
        assert gains.local_ns[0] == began_ns, "it was so when the recording began"
        assert recording.end_ns - recording.begin_ns < 60e9


def test_only_what_somebody_records_is_wanted(rings: RingsOfATest) -> None:
    with closing(ControlPage(rings.system, "PSM1")) as page:
        wanted = Subscriptions(page)
        box = rings.box()
        rings.write(1)
        box.step()
        wanted.look()
        assert wanted.wanted == 0
        named = rings.named("PSM1/state")
        wanted.look()
        assert wanted.wanted & wanted.bits("state", "wrench")
        named.end()
        wanted.look()
        assert wanted.wanted == 0
        box.close()
