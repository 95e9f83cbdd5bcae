"""Messages are those that ROS has: names, hashes and bytes."""

from __future__ import annotations

import inspect
from typing import Any

import pytest
from cyclonedds.idl import IdlStruct
from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.ros_messages import messages
from trocar.procs.ros_messages.hashes import dds_name, ros_name, type_hash
from trocar.procs.ros_messages.messages import Float64, JointStates, MessageHeader, PoseStamped, String, Time

# as `ros2 topic info -v` of ROS 2 Jazzy shows them
HASHES = {
    "builtin_interfaces/msg/Time": "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
    "std_msgs/msg/Header": "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
}
ALL = [kind for _, kind in inspect.getmembers(messages, inspect.isclass)
       if issubclass(kind, IdlStruct) and kind is not IdlStruct]


def test_hashes_are_those_that_ros_has() -> None:
    found = {ros_name(kind): type_hash(kind).removeprefix("RIHS01_") for kind in ALL}
    assert {name: found[name] for name in HASHES} == HASHES


def test_no_name_comes_twice_and_all_are_those_of_dds() -> None:
    names = [dds_name(kind) for kind in ALL]
    assert len(set(names)) == len(names)
    assert all("::dds_::" in name and name.endswith("_") for name in names)


def test_a_joint_state_has_the_bytes_that_ros_writes() -> None:
    data = JointStates(MessageHeader(Time(1, 2), "a"), ["j"], [1.0], [], [3.0]).serialize()
    assert data.hex() == (
        "00010000" "01000000" "02000000" "02000000" "6100" "0000"  # little-endian; 1 s, 2 ns; "a" with its length
        "01000000" "02000000" "6a00" "0000"  # one name
        "01000000" "000000000000f03f"  # one position, at a multiple of 8 bytes
        "00000000" "01000000" "0000000000000840")  # no velocity, one effort


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.__name__)
def test_what_was_written_is_read_again(kind: Any) -> None:
    assert kind.deserialize(kind().serialize()) == kind()


NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)


@given(names=st.lists(NAMES, max_size=8), numbers=st.lists(st.floats(allow_nan=False), max_size=8),
       frame=st.sampled_from(["", "a", "PSM1_base"]))
def test_any_joint_state_is_read_as_it_was_written(names: list[str], numbers: list[float], frame: str) -> None:
    message = JointStates(MessageHeader(Time(7, 9), frame), names, numbers, numbers[1:], numbers[2:])
    assert JointStates.deserialize(message.serialize()) == message


def test_messages_have_useful_defaults() -> None:
    assert PoseStamped().pose.orientation.w == 1.0 and String().data == "" and Float64().data == 0.0
