"""What a person or a test may do to the emulated boards and robots: the rows of the command table, carried out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from procs.boards.incidents import Incidents
from procs.boards.mishaps import Mishaps
from procs.boards.plant import Plant
from procs.lib.document import System, Tool
from shm.mailbox import Received

Values = npt.NDArray[np.float64]


class Orders:
    """Carries out commands at once."""

    def __init__(self, system: System, incidents: Incidents, mishaps: Mishaps, plant: Plant) -> None:
        """`plant` is the world's own."""
        self._system, self._plant = system, plant
        self._table: dict[str, Callable[[Values, str], None]] = {
            "press": lambda v, text: incidents.press(text, bool(_number(v, 0))),
            "amp_fault": lambda v, text: incidents.fail_amplifier(text, int(_number(v, 0)), bool(_number(v, 1))),
            "power_loss": lambda v, text: incidents.lose_supply(text, bool(_number(v, 0))),
            "encoder_jump": lambda v, text: incidents.jump_encoder(text, int(_number(v, 0)), int(_number(v, 1))),
            "lose_replies": lambda v, text: mishaps.strike("lost", max(0, int(_number(v, 0))), incidents.buses(text)),
            "push": lambda v, text: incidents.push(text, v.copy()),
            "insert_instrument": self._insert,
            "remove_instrument": lambda v, text: plant.remove_tool(text),
        }

    def carry_out(self, command: Received) -> None:
        """Do it and answer; a wrong argument refuses it with the reason."""
        order = self._table.get(command.name)
        if order is None:
            command.refuse(f"{command.name} is not possible here")
            return
        try:
            order(command.values, command.text)
        except (KeyError, ValueError) as error:
            command.refuse(str(error.args[0] if error.args else error))
            return
        command.done()

    def _insert(self, values: Values, text: str) -> None:
        arm, _, name = text.partition(" ")
        self._plant.insert_tool(arm, self._tool(arm, name.replace(":", "_")))

    def _tool(self, arm: str, name: str) -> Tool:
        tools = self._system.arm(arm).tools
        for tool in tools:
            if tool.name == name:
                return tool
        raise KeyError(f"{name}: not known to {arm}; there are {', '.join(t.name for t in tools) or 'none'}")


def _number(values: Values, at: int) -> float:
    if at >= len(values) or not np.isfinite(values[at]):
        raise ValueError(f"number {at + 1} is missing or not finite")
    return float(values[at])
