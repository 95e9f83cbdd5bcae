"""A whole system on another machine."""

from __future__ import annotations

from typing import Final, Self

from procs.arm_types import ARM_TYPES
from tools.client.distant import DistantRemote, DistantWays
from tools.client.instance import DISABLED, ENABLED, HOMED
from tools.errors import Problem

WORDS: Final = {ENABLED: "power_on", HOMED: "home", DISABLED: "power_off"}
WHOLE: Final = "system"
"""The process that brings all arms up, where there are consoles."""


class DistantSystem:
    """A system by its socket bridge; a context manager."""

    def __init__(self, ways: DistantWays) -> None:
        """Closed with us."""
        self._ways, self.name = ways, ways.name

    def arms(self) -> list[str]:
        """Names of its arms."""
        return [name for name, what in self._ways.instances.items() if what in ARM_TYPES]

    def power_on(self, timeout: float = 10.0) -> None:
        """Enable every arm, and the setup joints; Problem says which are not and why."""
        self._bring(ENABLED, timeout)

    def home(self, timeout: float = 60.0) -> None:
        """Home every arm, enabling those that are not."""
        self._bring(HOMED, timeout)

    def power_off(self, timeout: float = 10.0) -> None:
        """Disable every arm."""
        self._bring(DISABLED, timeout)

    def _bring(self, goal: str, timeout: float) -> None:
        if WHOLE in self._ways.instances:
            reply = DistantRemote(self._ways.connection, WHOLE).settled(WORDS[goal], timeout=timeout)
            if reply.outcome != "done":
                raise Problem(f"{WORDS[goal]} was {reply.outcome}: {reply.text}")
            return
        carts = [name for name, what in self._ways.instances.items() if what == "suj"]
        wrong = []
        for name in (*carts, *self.arms()):
            try:
                self._ways.bring(name, goal, timeout)
            except (Problem, TimeoutError) as error:
                wrong.append(str(error))
        if wrong:
            raise Problem("; ".join(wrong))

    def close(self) -> None:
        """Leave."""
        self._ways.connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
