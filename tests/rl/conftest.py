"""A running system that a host plays, and one PSM that a person has homed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.rl.homed import LentHosts, RunningHosts
from tests.rl.running import HostTime
from trocar.procs.host.host import HISTORY, Host
from trocar.procs.rl import attached


@pytest.fixture(scope="module")  # a host has 200 descriptors, of which a process has few
def lent() -> Iterator[LentHosts]:
    hosts = LentHosts()
    yield hosts
    hosts.end()


@pytest.fixture(scope="module")
def running() -> Iterator[RunningHosts]:
    hosts = RunningHosts()
    yield hosts
    hosts.end()


@pytest.fixture
def fresh() -> None:
    """For tests that want robots of their own."""


@pytest.fixture(autouse=True)
def homed_once(request: pytest.FixtureRequest, lent: LentHosts) -> Iterator[None]:
    """Robots of environments are homed once."""
    with pytest.MonkeyPatch.context() as patch:
        if "fresh" not in request.fixturenames:
            lent.patch(patch)
        yield


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch, running: RunningHosts) -> Callable[..., Host]:
    """A running system of this file; a person has homed the arms that are named."""

    def up(file: str, *homed: str, backend: str = "kinematic", history: int = HISTORY) -> Host:
        host = running.up(file, backend, history, homed)
        monkeypatch.setattr(HostTime, "host", host, raising=False)
        monkeypatch.setattr(attached, "SystemTime", HostTime)
        return host

    return up


@pytest.fixture
def psm(system: Callable[..., Host]) -> Host:
    """One PSM, homed by a person."""
    return system("kinematic.yaml", "PSM1")
