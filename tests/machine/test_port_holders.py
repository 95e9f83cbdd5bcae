"""Who has a port is named, so that a person knows what to stop; connections to it are counted."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from trocar.procs.boards.endpoints import Endpoints
from trocar.procs.document.system import BusConfig, Controller
from trocar.procs.machine.paths import ROOT
from trocar.procs.machine.port_holders import TCP, connections, holders
from trocar.procs.node.setup_error import SetupError
from trocar.shm.system.loglines import parsed

SUPERVISOR = """
import sys
from trocar.procs.supervisor import addresses, loop
addresses.BUS_PORT = int(sys.argv.pop(1))
loop.main()
"""


@pytest.fixture
def taken() -> Iterator[int]:
    """A port that somebody else has, at every address of the machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("0.0.0.0", 0))
        yield sock.getsockname()[1]


def test_a_holder_is_named_with_its_address_and_pid(taken: int) -> None:
    for address in ("127.91.8.16", "0.0.0.0"):
        (holder,) = holders(taken, address)
        assert holder.pid == os.getpid() and str(holder).endswith(f"(pid {os.getpid()}) has 0.0.0.0:{taken}")


def test_a_socket_at_another_address_is_not_in_the_way() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.91.8.16", 0))
        port = sock.getsockname()[1]
        assert [holder.address for holder in holders(port, "127.91.8.16")] == ["127.91.8.16"]
        assert holders(port, "127.91.8.32") == ()


def test_a_socket_of_both_families_counts() -> None:
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        sock.bind(("::", 0))
        assert [holder.address for holder in holders(sock.getsockname()[1], "127.91.8.16")] == ["::"]


def test_who_listens_is_named_and_connections_are_counted() -> None:
    with socket.create_server(("127.91.8.16", 0)) as server, socket.socket() as client:
        port = server.getsockname()[1]
        assert connections(port) == 0 and holders(port) == ()
        client.connect(("127.91.8.16", port))
        (holder,) = holders(port, "127.91.8.16", TCP)
        assert holder.pid == os.getpid() and connections(port) == 1, "one in the queue counts as well"
    assert connections(port) == 0


def test_emulated_boards_name_who_has_their_address(taken: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.procs.boards.endpoints.UDP_PORT", taken)
    with pytest.raises(SetupError, match=rf"emulated bus on 127.91.8.16, port {taken}: .*pid {os.getpid()}"):
        Endpoints((BusConfig("IO1", "127.91.8.16", (Controller(0),)),), lambda *_: None, lambda: 0, simulated=True)


@pytest.mark.slow
def test_a_system_that_gets_no_address_ends_with_one_line(taken: int, tmp_path: Path) -> None:
    words = [sys.executable, "-c", SUPERVISOR, str(taken), str(ROOT / "configs/systems/demo.yaml"), "--system", "taken"]
    done = subprocess.run(words, cwd=ROOT, env={**os.environ, "TROCAR_STATE": str(tmp_path)}, capture_output=True,
                          text=True, timeout=60, check=False)
    # A busy machine may have its warning. A line without a level, as of a traceback, would count.
    line, *others = (line for line in done.stderr.splitlines() if parsed(line).level != "WARNING")
    assert done.returncode == 1 and not others, done.stderr
    assert "no free loopback address" in line and f"pid {os.getpid()}" in line
