"""What stops a process and is no mistake of its program: the message says what is wrong, where, and what helps."""

from __future__ import annotations

from trocar.shm.memory.segment import SegmentError


class SetupError(Exception):
    """Something outside, as cables, boards or a file of the user; a log has it in one line, without a trace."""


def explains_itself(error: BaseException) -> bool:
    """Whether its message is all that a person needs."""
    return isinstance(error, (SegmentError, SetupError))
