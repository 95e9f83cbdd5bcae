"""What is packed by putting new numbers into old bytes is what cyclonedds would have written."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.ros_messages.messages import JointStates
from trocar.procs.ros_messages.packing import PackedMessage
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES

SIZES = {"cp": 7, "cv": 6, "cf": 6, "turn": 4}
NUMBERS = st.floats(allow_nan=False)


def blocks_of(kind: str, draw: Any) -> list[np.ndarray]:
    if kind == "js":
        return [np.array(draw(st.lists(NUMBERS, max_size=9)), dtype=np.float64) for _ in range(3)]
    size = SIZES.get(kind) or 6 * draw(st.integers(1, 8))
    return [np.array(draw(st.lists(NUMBERS, min_size=size, max_size=size)))]


@pytest.mark.parametrize("kind", VIEW_MESSAGES)
@examples(15)
@given(data=st.data())
def test_packed_messages_are_those_that_the_library_writes(kind: str, data: Any) -> None:
    row = VIEW_MESSAGES[kind]
    packed, plain = PackedMessage(row.message, row.put), row.message()
    for _ in range(3):  # sizes and texts may change from one to the next
        texts = (data.draw(st.sampled_from(["", "a", "frame", "longer frame"])),)
        blocks = blocks_of(kind, data.draw)
        stamp = data.draw(st.integers(0, 2**31 - 1)), data.draw(st.integers(0, 999))
        for message in (plain, packed.message):
            if hasattr(message, "header"):
                message.header.frame_id = texts[0]
            if isinstance(message, JointStates):
                message.name = list(texts * 2)
        row.put(plain, [block.tolist() for block in blocks])
        if hasattr(plain, "header"):
            plain.header.stamp.sec, plain.header.stamp.nanosec = stamp
        packed.pack(texts, blocks, stamp)
        assert packed.carrier.serialize() == plain.serialize()
        assert isinstance(packed.carrier, row.message)


def test_numbers_that_are_none_are_packed_as_they_are() -> None:
    row = VIEW_MESSAGES["cp"]
    packed = PackedMessage(row.message, row.put)
    packed.pack((), [np.full(7, np.nan)], (0, 0))
    assert np.isnan(row.message.deserialize(packed.carrier.serialize()).pose.position.x)
