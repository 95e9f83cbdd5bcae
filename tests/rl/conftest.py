"""A running system that a host plays, and one PSM that a person has homed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.rl.running import HostTime, home
from trocar.procs.host.host import HISTORY, Host
from trocar.procs.node import node_memory as node_memory
from trocar.procs.rl import attached
from trocar.procs.rl.hosted import document
from trocar.shm.mailbox.audit import Audit


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Host]]:
    """A running system of this file, nothing of it powered; of streams only their beginnings are in its audits."""
    hosts: list[Host] = []

    monkeypatch.setattr(node_memory, "Audit", lambda ring, now_ns, every: Audit(ring, now_ns))

    def up(file: str, backend: str = "kinematic", history: int = HISTORY) -> Host:
        hosts.append(Host(document(file, backend, 0.002, 0.002), history))
        hosts[-1].run(0.05)
        monkeypatch.setattr(HostTime, "host", hosts[-1], raising=False)
        monkeypatch.setattr(attached, "SystemTime", HostTime)
        return hosts[-1]

    yield up
    for host in hosts:
        host.close()


@pytest.fixture
def psm(system: Callable[..., Host]) -> Host:
    """One PSM, homed by a person."""
    host = system("kinematic.yaml")
    home(host, "PSM1")
    return host
