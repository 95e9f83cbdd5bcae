"""Every system has emulated buses of its own, also where its document names those of another one."""

from __future__ import annotations

import os
import socket
from dataclasses import replace

from trocar.procs.config import PROJECT_CONFIGS, Machine, load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.supervisor.addresses import BUS_PORT, at_free_addresses, free_address


def demo(name: str) -> SystemConfig:
    loaded = load_system(PROJECT_CONFIGS / "systems/demo.yaml", boards="emulated", name=name,
                         machine=Machine(free_address(name))).system
    assert loaded is not None
    return loaded


def test_a_document_is_started_beside_the_system_that_it_was_taken_from() -> None:
    system = demo(f"first{os.getpid()}")
    assert system.emulation is not None
    (bus,) = system.emulation.buses
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((bus.address, BUS_PORT))
        beside = at_free_addresses(system)
    assert beside.emulation is not None
    (other,) = beside.emulation.buses
    assert other.address != bus.address and other.address.startswith("127.")
    assert [io.port for io in beside.ios] == [f"udp:{other.address}"]
    assert replace(other, address=bus.address) == bus, "nothing else of it is another"


def test_all_there_is_on_a_bus_moves_with_it_and_robots_without_boards_stay() -> None:
    system = demo(f"second{os.getpid()}")
    assert system.emulation is not None
    (io,) = system.ios
    bare = replace(io, name="bare", port="")
    mixed = replace(system, ios=(io, bare), emulation=replace(system.emulation, ios=(io,)))
    moved = at_free_addresses(replace(mixed, name=f"third{os.getpid()}"))
    assert moved.emulation is not None and moved.emulation.ios is not None
    assert [each.port for each in moved.ios] == [f"udp:{moved.emulation.buses[0].address}", ""]
    assert [each.port for each in moved.emulation.ios] == [moved.ios[0].port] != [io.port]


def test_a_system_without_boards_is_as_it_was() -> None:
    system = load_system(PROJECT_CONFIGS / "systems/kinematic.yaml").system
    assert system is not None and at_free_addresses(system) is system
