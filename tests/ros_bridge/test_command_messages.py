"""Messages with commands: what is put into one is what is taken from it."""

from __future__ import annotations

import pytest

from tests.cases import cases
from trocar.procs.ros_messages.command_messages import MESSAGES

NUMBERS = {
    "empty": (), "bool": (1.0,), "number": (0.5,), "numbers": (0.5, 1.5), "button": (2.0,), "text": (), "state": (),
    "quaternion": (0.0, 0.0, 0.6, 0.8), "wrench": tuple(range(6)), "pose": tuple(range(7)),
    "framed pose": tuple(range(7)), "cartesian state": (*range(19), 1.0, 0.0, 1.0), "impedance": tuple(range(59))}


@cases("kind", MESSAGES)
def test_each_message_gives_back_what_was_put_into_it(kind: str) -> None:
    row, numbers = MESSAGES[kind], NUMBERS.get(kind, (0.1, 0.2, 0.3))
    made = row.made(numbers, "PSM1_base")
    assert tuple(row.numbers(made)) == pytest.approx(numbers)
    assert row.text(made) == ("PSM1_base" if row.text_at else "")
