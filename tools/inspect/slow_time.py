"""Simulated time that hardly goes on, and the process that it waits for."""

from __future__ import annotations

import contextlib
from collections import Counter
from typing import Final

from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.system_time import SystemTime

SLOW: Final = 0.02
"""Simulated over real time; a busy machine alone does not make it so slow."""
LOOKS: Final = 20
EVERY_S: Final = 0.01
NEARLY_ALWAYS: Final = 0.8


def waited_for(system: str) -> tuple[str, float]:
    """The process whose cycles take so long that time hardly passes, and how fast it does; "": none, or time is held.

    Looks for 0.2 s, where the last second was slow.
    """
    with contextlib.suppress(SegmentError), SystemTime(system) as time, contextlib.ExitStack() as held:
        if time.speed >= SLOW or time.is_held:
            return "", 1.0
        pages = {name: held.enter_context(contextlib.closing(ControlPage(system, name))) for name in time.members}
        awake: Counter[str] = Counter()
        begin_ns, begin_real_ns = time.now_ns(), monotonic_ns()
        for _ in range(LOOKS):
            pause(EVERY_S)
            awake.update(name for name, page in pages.items() if not page.get("wakeup"))
        speed = (time.now_ns() - begin_ns) / (monotonic_ns() - begin_real_ns)
        ((name, times),) = awake.most_common(1) or [("", 0)]
        if speed >= SLOW or time.is_held or times < NEARLY_ALWAYS * LOOKS:
            return "", 1.0
        return name, speed
    return "", 1.0
