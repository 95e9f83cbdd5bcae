"""Stopping a system: every process gets its time, however often and impatiently somebody asks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from procs import lifecycle
from procs.lib.document import Process, System
from procs.supervisor import loop
from procs.supervisor.loop import Supervisor
from shm.segment import names_of

SLOW = """
import signal, sys, time
def end(*_):
    time.sleep(0.3)
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
print("up", flush=True)
time.sleep(60)
"""


@pytest.fixture
def supervisor(world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Supervisor]:
    """A supervisor of one process, which takes 0.3 s to end well."""
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    monkeypatch.setattr(loop, "realtime", lambda *_, **__: "other")
    made = Supervisor(System(world.name, "", "wall", (), (), None, (Process("PSM1", "arm", 1 / 1500),)))
    child = world.start(SLOW)
    assert child.stdout.readline() == "up\n"
    made.children[0].popen, made.children[0].state = child, lifecycle.RUNNING
    yield made
    made.close()


def test_asking_again_while_it_stops_kills_nobody(supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch) -> None:
    ordinary = supervisor.let_time_pass

    def asked_again() -> None:
        supervisor.stopping = "got SIGINT"
        ordinary()

    monkeypatch.setattr(supervisor, "let_time_pass", asked_again)
    assert supervisor.stop_all()
    assert supervisor.children[0].reason == "stopped"


def test_a_supervisor_that_cannot_begin_leaves_no_memory(
    world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))

    def full(*_: object, **__: object) -> str:
        raise OSError("no space left on device")

    monkeypatch.setattr(loop, "realtime", full)
    with pytest.raises(OSError, match="no space"):
        Supervisor(System(world.name, "", "wall", (), (), None, (Process("PSM1", "arm", 1 / 1500),)))
    assert names_of(world.name) == []
