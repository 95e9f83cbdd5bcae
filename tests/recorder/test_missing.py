"""What the recorder says of the recording of the last fault."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

import pytest

from trocar.procs.recorder.loop import RecorderLoop


def tell(recorder: Mock, *, size: int, is_complete: bool, problem: str = "", span_ns: tuple[int, int] = (1, 2)) -> str:
    file = Mock(size=size, is_complete=is_complete, problem=problem, is_ended=True, dropped=0, path="fault.mcap")
    fault: Any = Mock(file=file, faults=[Mock(instance="IO1")], span_ns=span_ns, reason="power lost")
    RecorderLoop._tell_fault(recorder, fault)
    return str(recorder._missing)


@pytest.mark.parametrize(("size", "said"), [
    (100, "the recording of the last fault is not complete: No space left"),
    (0, "the last fault was not recorded: No space left")])
def test_a_fault_that_is_not_all_recorded_is_told_until_one_is(size: int, said: str) -> None:
    recorder = Mock(_missing="")
    assert tell(recorder, size=size, is_complete=False, problem="No space left") == said
    assert tell(recorder, size=100, is_complete=False, span_ns=(0, 0)) == said, "a request is no fault"
    assert tell(recorder, size=100, is_complete=True) == ""
