"""A whole system on another machine."""

from __future__ import annotations

from typing import Final

from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.shm.commands import became
from trocar.tools.client.distant import DistantRemote, DistantWays
from trocar.tools.client.instance import DISABLED, ENABLED, HOMED
from trocar.tools.client.sounds import WHOLE, Sounds
from trocar.tools.output.errors import Problem

WORDS: Final = {ENABLED: "power_on", HOMED: "home", DISABLED: "power_off"}


class DistantSystem(Sounds):
    """A system by its socket bridge; a context manager."""

    def __init__(self, ways: DistantWays) -> None:
        """Closed with us."""
        super().__init__(ways)
        self._distant = ways

    def arms(self) -> list[str]:
        """Names of its arms."""
        return [name for name, what in self._distant.instances.items() if what in ARM_TYPES]

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
        if WHOLE in self._distant.instances:
            reply = DistantRemote(self._distant.connection, WHOLE).settled(WORDS[goal], timeout=timeout)
            if reply.outcome != "done":
                raise Problem(f"{WORDS[goal]} {became(reply.outcome)}: {reply.text}")
            return
        carts = [name for name, what in self._distant.instances.items() if what == "suj"]
        wrong = []
        for name in (*carts, *self.arms()):
            try:
                self._distant.bring(name, goal, timeout)
            except (Problem, TimeoutError) as error:
                wrong.append(str(error))
        if wrong:
            raise Problem("; ".join(wrong))

    def close(self) -> None:
        """Leave."""
        super().close()
        self._distant.connection.close()
