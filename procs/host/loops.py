"""The loops of a host: those of the processes, but without sockets between io and the emulated boards."""

from __future__ import annotations

from typing import Final

from trocar.procs.arm.loop import ArmLoop
from trocar.procs.boards.loop import BoardsLoop
from trocar.procs.console.loop import ConsoleLoop
from trocar.procs.document.system import IoConfig
from trocar.procs.focus.loop import FocusLoop
from trocar.procs.fpga.port_name import PortName
from trocar.procs.host.bus import DirectTransport
from trocar.procs.host.node import HostedNode
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.loop import IoLoop
from trocar.procs.io.robots import Robots
from trocar.procs.io.start import POWER_OFF
from trocar.procs.node import runtime
from trocar.procs.node.node import Node
from trocar.procs.suj.loop import SetupLoop
from trocar.procs.system.loop import SystemLoop
from trocar.procs.system.sound import Sound
from trocar.procs.teleop.loop import TeleopLoop


class HostError(Exception):
    """A host cannot do this, for instance run a system of that kind; the message is the reason."""


class HostedBoards(BoardsLoop):
    """Emulated boards without sockets."""

    def _open(self) -> None:
        """Open no sockets."""


class HostedIo(IoLoop):
    """An io whose bus leads to the emulated boards in this process."""

    def __init__(self, node: Node, boards: HostedBoards | None) -> None:
        super().__init__(node)
        self._boards = boards

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
        return BusPort(transport, robots.board_ids, node.clock.now_ns, PortOptions(
            io.protocol, bridge=parts.bridge, real_time=False, first_control=POWER_OFF,
            unknown_firmware=io.unknown_firmware))


class HostedSystem(SystemLoop):
    """A system without sound, because its time is not real, and it may be one of many."""

    def _take_sound(self) -> Sound:
        return Sound(lambda program: None)


LOOPS: Final[dict[str, type[runtime.Loop]]] = {
    "boards": HostedBoards, "arm": ArmLoop, "suj": SetupLoop, "focus": FocusLoop, "teleop": TeleopLoop,
    "console": ConsoleLoop, "system": HostedSystem}


def made(node: HostedNode, boards: HostedBoards | None) -> runtime.Loop:
    """The loop of a node; HostError for a kind that needs a separate process."""
    if node.kind == "io":
        return HostedIo(node, boards)
    if node.kind not in LOOPS:
        raise HostError(f"{node.name}: a {node.kind} needs a separate process")
    return LOOPS[node.kind](node)
