"""Errors outside of the program that stop a process; their messages give cause, location and remedy."""

from __future__ import annotations

from typing import Final

from trocar.procs.machine.paths import NoStateFolder
from trocar.shm.memory.segment import SegmentError

SETUP_FAILED: Final = 3
"""Exit code of a process whose setup failed; without an error on its page, it could not attach to its memory."""
STAYS: Final = 78
"""Exit code of a process that is not restarted automatically: EX_CONFIG of sysexits.h."""


class SetupError(Exception):
    """A cause outside of the program, e.g. cables, boards or a user's file; logged in one line, without a trace."""


class LastingError(SetupError):
    """A cause that persists until a person fixes it: a restart of the process would not help."""


def exit_code(error: BaseException, otherwise: int) -> int:
    """The exit code of a process that this error ends."""
    return STAYS if isinstance(error, LastingError) else otherwise


def explains_itself(error: BaseException) -> bool:
    """Whether the message suffices, without a trace."""
    return isinstance(error, (NoStateFolder, SegmentError, SetupError))
