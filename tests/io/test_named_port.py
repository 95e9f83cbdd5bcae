"""A port has one owner on a machine."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.io.stub_bus import own_address
from trocar.procs.io.bus import named_port
from trocar.procs.io.bus.transport import PortError

HOLDER = """
import sys
from trocar.procs.io.bus import named_port
lock = named_port.hold(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


def test_a_second_owner_is_refused_with_the_first_ones_pid_until_it_is_gone() -> None:
    address = own_address()
    first = named_port.hold(f"udp:{address}")
    with pytest.raises(PortError, match=rf"port udpfw:{address}: in use by pid {os.getpid()}; allowed: one owner"):
        named_port.hold(f"udpfw:{address}")  # the same bus by another name
    named_port.hold(f"udp:{own_address()}").close()
    first.close()
    named_port.hold(f"udp:{address}").close()


def test_the_owner_is_told_by_its_name_and_system_and_lets_go_when_killed() -> None:
    address = f"udp:{own_address()}"
    command = [sys.executable, "-c", HOLDER, address, "--system", "lab", "--name", "IO1"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        try:
            with pytest.raises(PortError, match=rf"in use by IO1 of system lab \(pid {other.pid}\)"):
                named_port.hold(address)
        finally:
            other.kill()
    named_port.hold(address).close()


def test_whoever_asks_again_and_again_is_told_the_name_each_time() -> None:
    address = f"udp:{own_address()}"
    first = named_port.hold(address)
    for _ in range(20):
        with pytest.raises(PortError, match=f"in use by pid {os.getpid()}"):
            named_port.hold(address)
    first.close()
