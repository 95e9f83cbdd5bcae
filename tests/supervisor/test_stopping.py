"""Stopping a system: every process gets its time, however often and impatiently somebody asks."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from trocar.procs.document.system import Process, SystemConfig
from trocar.procs.node.setup_error import SetupError
from trocar.procs.supervisor import memory
from trocar.procs.supervisor import supervisor as running
from trocar.procs.supervisor.children import Ending
from trocar.procs.supervisor.os_process import OsProcess
from trocar.procs.supervisor.supervisor import Supervisor
from trocar.procs.tables import lifecycle
from trocar.shm.memory.segment import SegmentError, names_of
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage, create_control

SLOW = """
import signal, sys, time
def end(*_):
    time.sleep(0.3)
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
print("up", flush=True)
signal.pause()
"""


def process_of(supervisor: Supervisor) -> OsProcess:
    """What runs for its only instance."""
    process = supervisor.children[0].process
    assert isinstance(process, OsProcess)
    return process

NS = 1_000_000_000


@pytest.fixture
def supervisor(world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Supervisor]:
    """A supervisor of one process, which takes 0.3 s to end well and is not soon started again."""
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    monkeypatch.setattr(running, "realtime", lambda *_, **__: "other")
    row = Process("PSM1", "teleop", 1 / 1500, backoff_s=60.0)
    made = Supervisor(SystemConfig(world.name, "", "wall", (), (), None, (row,)))
    child = world.start(SLOW)
    assert child.stdout.readline() == "up\n"
    process_of(made).popen = child
    made.children[0].target, made.children[0].starts, made.children[0].runs = 1, 1, True
    yield made
    made.close()


def test_logs_of_an_earlier_run_are_put_aside_also_those_of_processes_that_this_run_lacks(
    world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    monkeypatch.setattr(running, "realtime", lambda *_, **__: "other")
    folder = tmp_path / world.name
    folder.mkdir()
    for name in ("PSM1", "ECM", "supervisor"):
        (folder / f"{name}.log").write_text("of an earlier run\n")
    with closing(Supervisor(SystemConfig(world.name, "", "wall", (), (), None, (Process("PSM1", "teleop", 0.01),)))):
        assert sorted(path.name for path in folder.glob("*.log")) == ["ECM.1.log", "PSM1.1.log", "supervisor.1.log"]


def test_whoever_is_answered_finds_it_shown(supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = directory.reader(supervisor.system.name, "supervisor", "state")
    shown: list[bytes] = []

    def answer() -> None:
        assert reader.newest()
        shown.append(bytes(reader.field("lifecycle")[0]))

    monkeypatch.setattr(supervisor._requests, "answer", answer)
    supervisor.step()
    supervisor.children[0].stop()
    supervisor.step()
    end_ns = monotonic_ns() + 30_000_000_000
    while supervisor.children[0].state != lifecycle.STOPPED:
        assert monotonic_ns() < end_ns
        supervisor.step()
    assert shown[0] == b"RUNNING" and shown[1] == b"STOPPING" and shown[-1] == b"STOPPED"
    reader.close()


def test_asking_again_while_it_stops_kills_nobody(supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch) -> None:
    ordinary = supervisor.let_time_pass

    def asked_again() -> None:
        supervisor.stopping = "got SIGINT"
        ordinary()

    monkeypatch.setattr(supervisor, "let_time_pass", asked_again)
    assert supervisor.stop_all()
    assert supervisor.children[0].reason == "stopped"


def test_a_name_has_one_supervisor_and_is_free_again_after_it(world: Any) -> None:
    first = memory.hold_name(world.name)
    with pytest.raises(SegmentError, match="is up already"):
        memory.hold_name(world.name)
    first.close()
    memory.hold_name(world.name).close()


@pytest.mark.parametrize(("version", "named"), [(None, r"pid \d+"), (1, "of another version")])
def test_memory_of_processes_that_still_run_is_not_cleared_whatever_their_version(
        world: Any, monkeypatch: pytest.MonkeyPatch, version: int | None, named: str) -> None:
    monkeypatch.setattr(memory, "ORPHANS_NS", 100_000_000)
    create_control(world.name, "IO1")
    orphan = ControlPage(world.name, "IO1", write=True)
    orphan.segment.claim("IO1")
    if version is not None:
        orphan.segment.view[8:12] = version.to_bytes(4, "little")  # in the header
    with pytest.raises(SegmentError, match=rf"still run: IO1 \({named}"):
        memory.clear_left_over(world.name)
    assert names_of(world.name)
    orphan.close()
    assert memory.clear_left_over(world.name) == 1


HANGING = """
import faulthandler, signal
faulthandler.register(signal.SIGUSR1, file=2, all_threads=False)
def step():
    print("up", flush=True)
    while True:
        pass
step()
"""


def test_a_process_that_hangs_is_traced_goes_on_and_its_end_says_where(
        supervisor: Supervisor, tmp_path: Path) -> None:
    child, process = supervisor.children[0], process_of(supervisor)
    (tmp_path / "wall.py").write_text(HANGING)
    process.log.write_bytes(b'old (most recent call first):\n  File "other.py", line 1 in other\n')
    first = process.popen
    with process.log.open("ab") as log:
        process.popen = subprocess.Popen([sys.executable, tmp_path / "wall.py"], stdout=subprocess.PIPE, stderr=log)
    stdout = process.popen.stdout
    assert stdout is not None and stdout.readline() == b"up\n"
    child.kill_hung(1.0)
    begin_ns, ending = monotonic_ns(), None
    while ending is None and monotonic_ns() < begin_ns + 30 * NS:
        ending = child.look()
    assert ending is not None
    assert re.fullmatch(r"hung for 1.0 s, killed; where: wall.py line [567] in step, trocar logs PSM1", ending.text)
    stdout.close()
    assert isinstance(first, subprocess.Popen)
    first.kill()
    first.wait(10)


def test_who_ends_while_the_system_starts_is_not_said_to_be_restarted(
        supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    process = process_of(supervisor)
    assert process.popen is not None
    monkeypatch.setattr(supervisor._template, "has_imported", lambda: True)
    process.popen.kill()
    with pytest.raises(SetupError, match="PSM1: killed by SIGKILL"):
        supervisor.start_all()
    assert "PSM1 ended: killed by SIGKILL; the system cannot start without it" in caplog.text
    assert "restart" not in caplog.text


def test_a_process_that_does_not_end_when_restarted_is_killed(supervisor: Supervisor) -> None:
    child, popen = supervisor.children[0], process_of(supervisor).popen
    assert popen is not None
    popen.send_signal(signal.SIGSTOP)
    child.stop()
    child.ensure()
    child.kill_at_ns = 1
    ending = child.look()
    child.kill_at_ns = 1
    ending = ending or child.look()
    popen.wait(10)
    ending = ending or child.look()
    assert ending is not None and ending.killed and ending.asked
    assert child.state == lifecycle.STOPPED and child.reason == "stopped: did not end within 3 s, killed"


def test_the_message_about_a_killed_process_has_the_consequences_of_its_kind(
    world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    monkeypatch.setattr(running, "realtime", lambda *_, **__: "other")
    with closing(Supervisor(SystemConfig(world.name, "", "wall", (), (), None,
                                         (Process("PSM1", "teleop", 0.01),)))) as made:
        for kind, more in (("gui", ""), ("io", "; boards whose watchdog is on have switched its amplifiers off")):
            made.children[0].row = Process("one", kind, 0.01)
            made._ended(made.children[0], Ending("stopped: did not end within 3 s, killed", True, True))
            assert caplog.messages[-1].partition(", killed")[2] == f"{more}; trocar logs one may say why"


def test_a_supervisor_that_cannot_begin_leaves_no_memory(
    world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))

    def full(*_: object, **__: object) -> str:
        raise OSError("no space left on device")

    monkeypatch.setattr(running, "realtime", full)
    with pytest.raises(OSError, match="no space"):
        Supervisor(SystemConfig(world.name, "", "wall", (), (), None, (Process("PSM1", "teleop", 1 / 1500),)))
    assert names_of(world.name) == []


def test_a_supervisor_that_was_held_up_ends_instead_of_starting_all_again(
    supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch
) -> None:
    supervisor.beat()
    child, popen = supervisor.children[0], process_of(supervisor).popen
    assert popen is not None
    popen.kill()  # it has noticed that we were away
    popen.wait(10)
    monkeypatch.setattr(running, "monotonic_ns", lambda: monotonic_ns() + 3_000_000_000)
    supervisor.run(None)
    assert supervisor.lost and child.restarts == 0 and process_of(supervisor).pid == 0
    assert re.match(r"stalled for \d+\.\d s; its processes have ended", supervisor.stopping)


@pytest.mark.slow
def test_being_asked_to_stop_while_starting_starts_nobody_else(
    supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []

    def begin(process: OsProcess) -> None:
        started.append(process.row.name)
        supervisor.stopping = "got SIGINT"

    monkeypatch.setattr(OsProcess, "begin", begin)
    rows = [Process(name, "arm", 1 / 1500) for name in ("PSM1", "PSM2")]
    supervisor._pages["PSM2"] = supervisor._pages["PSM1"]
    monkeypatch.setattr(running, "ControlPage", lambda system, name, write: supervisor._pages[name])
    monkeypatch.setitem(supervisor._listening, "PSM2", supervisor._listening["PSM1"])
    made = [supervisor._child(row) for row in rows]
    supervisor.children[1:], supervisor._waves = made, [[*made, supervisor.children[0]]]
    monkeypatch.setattr(supervisor, "_show", lambda: None)
    supervisor.start_all()
    for child in made:
        child.runs = False
    assert supervisor.stop_all() and started == ["PSM1"]


def test_the_memory_that_all_share_is_locked_behind_those_that_drive_robots(
    supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []

    def noted(name: str, result: object) -> Callable[..., object]:
        return lambda *_: (order.append(name), result)[1]

    monkeypatch.setattr(running, "step_back", noted("step back", None))
    monkeypatch.setattr(running, "lock_shared", noted("lock", "locked"))
    monkeypatch.setattr(running, "realtime", noted("come forward", ["FIFO 7"]))
    kept, supervisor._waves, supervisor._rows = supervisor._waves, [], ()
    supervisor.start_all()
    assert order == ["step back", "lock", "come forward"]
    assert supervisor.page.get("policy") == b"FIFO 7, locked"
    supervisor._waves = kept
    assert supervisor.stop_all()


def test_nobody_is_left_behind_before_all_were_killed_and_had_the_time_to_be_gone(supervisor: Supervisor) -> None:
    child, now = supervisor.children[0], [10 * NS]
    child.now_ns = lambda: now[0]
    for now[0] in (12 * NS, 60 * NS):  # we were held up, or it is spared
        assert not child.is_gone
    child.killed_ns = 61 * NS
    for now[0], is_gone in ((61 * NS, False), (64 * NS, False), (66 * NS, True)):
        assert child.is_gone == is_gone
    child.now_ns, child.killed_ns = monotonic_ns, 0
    assert supervisor.stop_all()
