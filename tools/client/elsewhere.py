"""What stands in the place of `here` on a machine that has no shared memory of ours: words that say so."""

from __future__ import annotations

from typing import Any, NoReturn

from trocar.tools.output.errors import Problem


class OnlyHere:
    """Something that needs the robot's own machine."""

    def __init__(self, *given: Any, **named: Any) -> None:
        """Problem."""
        needs_shared_memory()


Handler = Process = Provider = System = OnlyHere


def needs_shared_memory(*given: Any, **named: Any) -> NoReturn:
    """Problem says what there is instead."""
    raise Problem('this needs the robot\'s own machine (Linux, posix_ipc); from here: trocar.arm(NAME, at="HOST:PORT")')


arm_here = operated_here = suj_here = provide = system_here = needs_shared_memory
