"""Which class opens a port, by its name."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from trocar.procs.fpga.ports import ETHERNET, UDP, PortName, PortNameError
from trocar.procs.io.bus.bus_port import BusPort
from trocar.procs.io.bus.ethernet import EthernetTransport, interface_of
from trocar.procs.io.bus.firewire import FirewireTransport
from trocar.procs.io.bus.port import BROADCAST_QUERY, PortError
from trocar.procs.io.bus.transport import Transport
from trocar.procs.io.bus.udp import UdpTransport


def named(name: str) -> PortName:
    """The parts of a port's name; PortError for ports that cannot be opened."""
    try:
        return PortName.parse(name)
    except PortNameError as error:
        raise PortError(error.what, f"port {name}", f"allowed: {error.allowed}") from error


def owned(name: str) -> str:
    """What one owner at a time may have: the same for all names of one bus."""
    parts = named(name)
    if parts.kind == ETHERNET:
        return f"{ETHERNET}:{interface_of(parts.where)}"
    return parts.owned


def transport_of(name: PortName) -> Transport:
    """What carries datagrams to the boards of a port; nothing is opened yet."""
    if name.kind == UDP:
        return UdpTransport(name.where, bridge=name.bridge)
    if name.kind == ETHERNET:
        return EthernetTransport(name.where)
    return FirewireTransport(int(name.where))


def port_of(name: str, board_ids: Sequence[int], now_ns: Callable[[], int], protocol: str = BROADCAST_QUERY, *,
            real_time: bool = True, first_control: int = 0, quiet: bool = False, spin_ns: int = 0,
            query_wait_ns: int | None = None) -> BusPort:
    """The port `name`, as configuration files write it, with its boards; nothing is opened yet. See `BusPort`."""
    parts = named(name)
    return BusPort(transport_of(parts), board_ids, now_ns, protocol, bridge=parts.bridge, real_time=real_time,
                   first_control=first_control, quiet=quiet, spin_ns=spin_ns, query_wait_ns=query_wait_ns)
