"""Addresses that the supervisor holds for its processes, and how they get them."""

from __future__ import annotations

import fcntl
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing

import pytest

from tests.cases import cases
from trocar.procs.document.process import Process, host_and_port
from trocar.procs.node.setup_error import SetupError
from trocar.procs.supervisor.listening import LOOK_NS, Listening
from trocar.procs.supervisor.os_process import HANDOVER, ROOT

HOST = "127.91.9.16"
ANSWER = """
import os
from trocar.procs.machine.listening import handed
assert os.environ["LISTEN_PID"] == str(os.getpid())
first, second = handed()
assert not [number for number in range(5, 200) if os.path.exists(f"/proc/self/fd/{number}")], "each of them once"
assert (first.fileno(), second.fileno()) == (3, 4) and not os.get_inheritable(3) and not first.getblocking()
for each in (second, first):
    connection, _ = each.accept()
    connection.sendall(str(each.getsockname()[1]).encode())
    connection.close()
"""


def free() -> str:
    """An address where nobody listens."""
    with socket.create_server((HOST, 0)) as server:
        return f"{HOST}:{server.getsockname()[1]}"


def row(*addresses: str) -> Process:
    return Process("gui", "user", 0.01, listen=addresses)


@pytest.fixture
def listening() -> Iterator[Listening]:
    with closing(Listening(row(free(), free()))) as made:
        yield made


def test_it_is_wanted_while_somebody_waits_or_is_connected(listening: Listening) -> None:
    assert not listening.is_wanted(0, False) and not listening.is_wanted(0, True)
    with socket.create_connection(listening.sockets[1].getsockname()):
        assert listening.is_wanted(LOOK_NS, False), "somebody waits, and nobody is there"
        accepted, _ = listening.sockets[1].accept()
        assert listening.is_wanted(LOOK_NS, True), "somebody is connected"
        accepted.close()
    assert listening.is_wanted(LOOK_NS + 1, True), "the kernel is not asked in every beat"
    assert not listening.is_wanted(LOOK_NS + 1, True, is_last=True), "but before it is stopped"
    assert not listening.is_wanted(LOOK_NS + 2, True)
    with socket.create_connection(listening.sockets[0].getsockname()) as client:
        accepted, _ = listening.sockets[0].accept()
        assert not listening.is_wanted(LOOK_NS + 3, True)
        assert listening.is_wanted(LOOK_NS + 3, True, is_last=True)
        client.close()
        accepted.close()
    assert not listening.is_wanted(3 * LOOK_NS, True)


def test_who_waits_for_one_that_will_not_be_there_is_turned_away(listening: Listening) -> None:
    with socket.create_connection(listening.sockets[0].getsockname(), timeout=10) as client:
        assert listening.is_wanted(0, False, is_refused=True) and client.recv(10) == b""
    assert not listening.is_wanted(0, False, is_refused=True)


def test_an_address_in_use_names_who_has_it(listening: Listening) -> None:
    address = "{}:{}".format(*listening.sockets[0].getsockname())
    with pytest.raises(SetupError, match=rf"gui cannot listen at {address}: .*\(pid \d+\) has {address}"):
        Listening(row(free(), address))


def test_an_address_that_this_machine_has_not_is_an_error() -> None:
    with pytest.raises(SetupError, match=r"gui cannot listen at 192\.0\.2\.1:8080: Cannot assign"):
        Listening(row("192.0.2.1:8080"))


def test_a_program_gets_the_sockets_as_from_systemd(listening: Listening) -> None:
    first, second = (each.fileno() for each in listening.sockets)
    numbers = [first, fcntl.fcntl(second, fcntl.F_DUPFD, 100)]
    words = [sys.executable, "-I", "-S", str(HANDOVER), ",".join(map(str, numbers)), sys.executable, "-c", ANSWER]
    clients = [socket.create_connection(each.getsockname()) for each in listening.sockets]  # before it is there
    subprocess.run(words, cwd=ROOT, pass_fds=numbers, env={"LISTEN_FDS": "2"}, check=True, timeout=30)
    os.close(numbers[1])
    for client, each in zip(clients, listening.sockets, strict=True):
        with client:
            assert client.recv(100) == str(each.getsockname()[1]).encode()


@cases("address", ["8080", "localhost:8080", "127.0.0.1", "127.0.0.1:", "127.0.0.1:0", "::1:8080",
                   "127.0.0.1:65536", "127.0.0.1:-1", "[127.0.0.1:80"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(ValueError):
        host_and_port(address)


def test_addresses_of_both_families_are_read() -> None:
    assert host_and_port("127.0.0.1:8080") == ("127.0.0.1", 8080)
    assert host_and_port("[::1]:8080") == ("::1", 8080)
