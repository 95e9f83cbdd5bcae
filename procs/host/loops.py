"""The loops of a host: those of the processes, but that io and the emulated boards need no sockets between them."""

from __future__ import annotations

from typing import Final

from procs import runtime
from procs.arm.loop import ArmLoop
from procs.boards.loop import BoardsLoop
from procs.console.loop import ConsoleLoop
from procs.document.system import IoConfig
from procs.focus.loop import FocusLoop
from procs.fpga.ports import PortName
from procs.host.bus import DirectTransport
from procs.host.node import HostedNode
from procs.io.bus.bus_port import BusPort
from procs.io.loop import IoLoop
from procs.io.robots import Robots
from procs.io.start import POWER_OFF
from procs.suj.loop import SetupLoop
from procs.system.loop import SystemLoop
from procs.system.sound import Sound
from procs.teleop.loop import TeleopLoop


class HostError(Exception):
    """A system that cannot run in one process; says why."""


class HostedBoards(BoardsLoop):
    """Boards that are asked without sockets."""

    def _open(self) -> None:
        """Nobody asks from outside."""


class HostedIo(IoLoop):
    """An io whose bus are the boards of this process."""

    def __init__(self, node: runtime.Node, boards: HostedBoards | None) -> None:
        self._boards = boards
        super().__init__(node)

    def _take_port(self, io: IoConfig, robots: Robots) -> BusPort:
        node, boards = self.node, self._boards
        emulation = node.document.emulation
        if boards is None or emulation is None:
            raise HostError(f"{io.name}: its port is {io.port}; a host has emulated boards only")
        parts = PortName.parse(io.port)
        bus = next((n for n, row in enumerate(emulation.buses) if row.address == parts.where), -1)
        if bus < 0:
            raise HostError(f"{io.name}: no emulated bus is at {parts.where}")
        transport = DirectTransport(boards.world, bus, parts.where, node.clock.now_ns)
        return BusPort(transport, robots.board_ids, node.clock.now_ns, io.protocol, bridge=parts.bridge,
                       real_time=False, first_control=POWER_OFF)


class HostedSystem(SystemLoop):
    """A system that is not heard: its time is another, and it may be one of many; programs it needs none."""

    def _take_sound(self) -> Sound:
        return Sound(lambda program: None)


LOOPS: Final[dict[str, type[runtime.Loop]]] = {
    "boards": HostedBoards, "arm": ArmLoop, "suj": SetupLoop, "focus": FocusLoop, "teleop": TeleopLoop,
    "console": ConsoleLoop, "system": HostedSystem}


def made(node: HostedNode, boards: HostedBoards | None) -> runtime.Loop:
    """The loop of a node; HostError for a kind that needs a process of its own."""
    if node.kind == "io":
        return HostedIo(node, boards)
    if node.kind not in LOOPS:
        raise HostError(f"{node.name}: a {node.kind} needs a process of its own")
    return LOOPS[node.kind](node)
