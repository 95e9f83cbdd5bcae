"""What stops a process and is no mistake of its program: the message says what is wrong, where, and what helps."""

from __future__ import annotations

from typing import Final

from trocar.procs.machine.paths import NoStateFolder
from trocar.shm.memory.segment import SegmentError

STAYS: Final = 78
"""Exit code of a process that is not started again by itself: EX_CONFIG of sysexits.h."""


class SetupError(Exception):
    """Something outside, as cables, boards or a file of the user; a log has it in one line, without a trace."""


class LastingError(SetupError):
    """What stays as it is until a person changes it: nothing is gained by starting the process again."""


def exit_code(error: BaseException, otherwise: int) -> int:
    """With which exit code this error ends a process."""
    return STAYS if isinstance(error, LastingError) else otherwise


def explains_itself(error: BaseException) -> bool:
    """Whether its message is all that a person needs."""
    return isinstance(error, (NoStateFolder, SegmentError, SetupError))
