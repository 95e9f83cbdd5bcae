"""Messages are those that ROS has: names, hashes and bytes."""

from __future__ import annotations

import inspect
import subprocess
import sys
from typing import Any

import pytest
from cyclonedds.idl import IdlStruct
from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import ROOT
from tests.examples import examples
from trocar.procs.ros_messages import messages
from trocar.procs.ros_messages.cdr import packed
from trocar.procs.ros_messages.definitions import definition
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


def test_what_was_written_is_read_again() -> None:
    for kind in ALL:
        message: Any = kind()
        assert kind.deserialize(message.serialize()) == message, kind


NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)


@examples(40)
@given(names=st.lists(NAMES, max_size=8), numbers=st.lists(st.floats(allow_nan=False), max_size=8),
       frame=st.sampled_from(["", "a", "PSM1_base"]))
def test_any_joint_state_is_read_as_it_was_written(names: list[str], numbers: list[float], frame: str) -> None:
    message = JointStates(MessageHeader(Time(7, 9), frame), names, numbers, numbers[1:], numbers[2:])
    assert JointStates.deserialize(message.serialize()) == message


def test_messages_have_useful_defaults() -> None:
    assert PoseStamped().pose.orientation.w == 1.0 and String().data == "" and Float64().data == 0.0


def filled(kind: Any, draw: Any) -> Any:
    """A message, or another value of this annotation, with any content."""
    meant = kind.__metadata__[0] if hasattr(kind, "__metadata__") else kind
    if hasattr(meant, "subtype"):
        size = int(getattr(meant, "length", 0)) or draw(st.integers(0, 3))
        return [filled(meant.subtype, draw) for _ in range(size)]
    if meant is bool or isinstance(meant, str):
        return draw(ANY[meant])
    if meant is str or hasattr(meant, "max_length"):
        return draw(NAMES)
    return kind(**{name: filled(field, draw) for name, field in kind.__annotations__.items()})


ANY = {bool: st.booleans(), "uint8": st.integers(0, 255), "int32": st.integers(-2**31, 2**31 - 1),
       "uint32": st.integers(0, 2**32 - 1), "int64": st.integers(-2**63, 2**63 - 1),
       "float32": st.floats(width=32), "float64": st.floats()}


@pytest.mark.parametrize("kind", ALL)
@examples(5)
@given(data=st.data())
def test_messages_have_the_bytes_that_the_library_writes(kind: Any, data: Any) -> None:
    message = filled(kind, data.draw)
    assert packed(message) == message.serialize()


WITHOUT = """
import dataclasses, inspect, sys
sys.modules["cyclonedds"] = None
from trocar.procs.ros_messages import cdr, messages
from trocar.procs.ros_messages.definitions import definition
kinds = [kind for _, kind in inspect.getmembers(messages, inspect.isclass) if dataclasses.is_dataclass(kind)]
for kind in kinds:
    print(kind.__name__, repr(definition(kind)), cdr.packed(kind()).hex())
"""


def test_definitions_and_bytes_need_no_library() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"{kind.__name__} {definition(kind)!r} {packed(kind()).hex()}" for kind in ALL]
