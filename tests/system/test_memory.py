"""All of a system's shared memory: how much it is, whose it is, and what happens when there is no room for it."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import grp
import json
import os
import pwd
import socket
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.system.robot import DEMO, ROOT, Robot
from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.recorder.fault import AFTER_NS
from trocar.procs.supervisor import memory
from trocar.procs.supervisor.supervisor import Supervisor
from trocar.procs.tables.manifest import proc
from trocar.shm.memory import parts
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.owners import SERVICE_USER
from trocar.shm.memory.parts import remove_all, removed_words
from trocar.shm.memory.segment import (
    FOLDER,
    Segment,
    SegmentError,
    SegmentFull,
    create,
    names_of,
    path_of,
    segment_name,
    unlink,
)
from trocar.shm.system import directory
from trocar.shm.system.directory import systems
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.lockstep import Timekeeper
from trocar.shm.topics import ARM_STATE
from trocar.tools.output.errors import Problem
from trocar.tools.systems import find
from trocar.tools.systems.find import chosen_system, left_over

pytestmark = pytest.mark.patient
STRANGER = 4242
IN_A_CONTAINER = 64 << 20
"""Size of /dev/shm in a container without options."""


@pytest.fixture
def system(world: Any) -> SystemConfig:
    """The demo's document under this world's name."""
    loaded = load_system(DEMO, name=world.name, sets=["clock=wall"])
    assert loaded.system is not None
    return loaded.system


def paths(name: str) -> list[Path]:
    return [path_of(segment_name(*parts)) for parts in names_of(name)]


def as_root() -> None:
    if os.getuid() != 0:
        pytest.skip("only root can give files away")


@contextlib.contextmanager
def of_stranger(name: str) -> Iterator[None]:
    """All segments of a system belong to somebody else."""
    as_root()
    files = paths(name)
    for path in files:
        os.chown(path, STRANGER, -1)
    try:
        yield
    finally:
        for path in files:
            os.chown(path, 0, -1)


def test_the_total_is_known_before(system: SystemConfig) -> None:
    needed = memory.needed(system)
    assert names_of(system.name) == []
    assert memory.create_all(system) == needed == sum(path.stat().st_size for path in paths(system.name))
    remove_all(system.name)


def test_the_clock_of_a_lock_step_counts_too(system: SystemConfig) -> None:
    simulated = dataclasses.replace(system, clock="lockstep")
    total = memory.create_all(simulated)
    keeper = Timekeeper(system.name, memory.simulated(simulated))
    keeper.close()
    remove_all(system.name)
    assert memory.needed(simulated) == total + keeper.size


@pytest.mark.parametrize(("file", "most_mb"), [("demo", 24), ("demo-teleop", 30), ("kinematic-full", 60)])
def test_a_container_has_room_for_the_examples_of_the_readme(file: str, most_mb: int) -> None:
    system = load_system(PROJECT_CONFIGS / "systems" / f"{file}.yaml", records=True).system
    assert system is not None
    needed = memory.needed(system)
    assert needed <= most_mb * 1e6 and needed < IN_A_CONTAINER * (1.0 - memory.RESERVED_PART)


def test_arms_on_boards_keep_a_second_and_a_half_before_a_fault(system: SystemConfig) -> None:
    memory.create_all(memory.fitted(system))
    reader = directory.reader(system.name, "PSM1", "state", "arm")
    before_s = reader.depth / 1500.0 - AFTER_NS * 1e-9
    reader.close()
    remove_all(system.name)
    assert before_s > 1.5 + 2 * proc("recorder").period_s  # it sees the fault a period later, and reads one after that


def test_where_less_is_free_rings_keep_less_and_that_is_said(
    system: SystemConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = memory.needed(system)
    monkeypatch.setattr(memory, "reserve", lambda: memory.RESERVE)
    assert memory.fitted(system) == system and memory.history_s(system) == directory.HISTORY_S
    for free in (usual + memory.RESERVE - 1, 16_000_000):
        monkeypatch.setattr(memory, "free_bytes", lambda system, free=free: free)
        short = memory.fitted(system)
        room = free - memory.RESERVE - memory.needed(short)
        assert 0 <= room < usual * 2 * memory.STEP_S / directory.HISTORY_S
        assert directory.MIN_HISTORY_S <= short.history_s < directory.HISTORY_S
        assert f"{short.history_s:.2f} s instead of 1.87 s" in short.shortage
        assert f"{free / 1e6:.1f} MB" in short.shortage and "--shm-size" in short.shortage
    assert memory.create_all(short) == free - memory.RESERVE - room
    remove_all(system.name)
    monkeypatch.setattr(memory, "free_bytes", lambda system: usual + memory.RESERVE)
    assert memory.fitted(short) == system, "a document from a smaller machine"


@pytest.mark.parametrize(("size", "reserved"), [(8 << 20, 2e6), (100_000_000, 5e6), (32 << 30, 32e6)])
def test_other_programs_keep_a_part_of_shared_memory_within_bounds(
        size: int, reserved: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_size", lambda: size)
    assert memory.reserve() == reserved


def test_too_little_room_is_said_before_anything_is_made(system: SystemConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "reserve", lambda: memory.RESERVE)
    monkeypatch.setattr(memory, "free_bytes", lambda system: 10_000_000)
    match = r"needs [\d.]+ MB and 2.0 MB for other programs, 10.0 MB are free in /dev/shm"
    with pytest.raises(SegmentFull, match=match) as caught:
        memory.fitted(system)
    reported = str(caught.value)
    assert "\n" not in reported and names_of(system.name) == []
    assert all(word in reported for word in ("trocar down", "mount -o remount,size=", "--shm-size="))
    enough = round(float(reported.split("needs ")[1].split()[0]) * 1e6) + memory.RESERVE + 100_000
    monkeypatch.setattr(memory, "free_bytes", lambda system: enough)
    assert directory.MIN_HISTORY_S <= memory.fitted(system).history_s < directory.MIN_HISTORY_S + 0.03


def test_no_start_and_no_end_of_a_system_looks_like_the_removal_of_its_memory(
        system: SystemConfig, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    looks: list[str] = []

    def looked(act: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            done = act(*arguments, **named)
            looks.append(removed_words(system.name))
            return done
        return call

    monkeypatch.setattr(memory, "create", looked(create))
    monkeypatch.setattr(parts, "unlink", looked(unlink))
    with contextlib.closing(Supervisor(dataclasses.replace(system, clock="lockstep"))) as supervisor:
        assert supervisor.keeper is not None
        supervisor.keeper.close()  # else its process does, at its end
        segments = len(names_of(system.name))
        path = path_of(segment_name(system.name, "PSM1", "state"))
        aside = path.rename(path.with_name(f"aside-{system.name}"))
        assert removed_words(system.name).startswith(f"1 of {segments} segments were removed")
        aside.rename(path)
    assert looks == [""] * 2 * segments


@pytest.mark.parametrize("after", [0, 1, 5, 11])
def test_room_that_runs_out_leaves_nothing(system: SystemConfig, monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    fill, calls = os.posix_fallocate, []

    def fill_some(fd: int, offset: int, size: int) -> None:
        calls.append(size)
        if len(calls) > after:
            raise OSError(errno.ENOSPC, "No space left on device")
        fill(fd, offset, size)

    monkeypatch.setattr(os, "posix_fallocate", fill_some)
    with pytest.raises(SegmentFull, match=rf"system {system.name} needs \d+\.\d MB"):
        memory.create_all(system)
    assert len(calls) == after + 1 and names_of(system.name) == []


@pytest.mark.parametrize("umask", [0, 0o077, 0o777])
@pytest.mark.parametrize("shared", [False, True])
def test_modes_and_group_are_those_configured(system: SystemConfig, umask: int, shared: bool) -> None:
    group = next(g for g in grp.getgrall() if os.getuid() == 0 or g.gr_gid in os.getgroups())
    make = memory.maker(group.gr_name if shared else "")
    before = os.umask(umask)
    try:
        memory.create_all(system, make)
        Timekeeper(system.name, memory.simulated(system), make).close()
    finally:
        os.umask(before)
    found = {(stat.S_IMODE(p.stat().st_mode), p.stat().st_gid) for p in paths(system.name)}
    remove_all(system.name)
    assert found == {(0o660, group.gr_gid) if shared else (0o600, os.getgid())}


@pytest.mark.slow
def test_the_whole_running_system_has_its_group(robot: Robot) -> None:
    as_root()
    group = grp.getgrgid(1)
    robot.up(DEMO, "--set", f"group={group.gr_name}", "--set", "service_user=daemon", "--set", "clock=lockstep")
    found = {(stat.S_IMODE(p.stat().st_mode), p.stat().st_gid, p.stat().st_uid) for p in paths(robot.name)}
    assert found == {(0o660, 1, 0)}
    assert path_of(segment_name(robot.name, "supervisor", "clock")) in paths(robot.name)
    assert json.loads(robot.trocar("status", "--json"))["system"] == robot.name
    assert robot.down() == 0


def test_a_configured_service_user_is_trusted(system: SystemConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    as_root()
    monkeypatch.setenv(SERVICE_USER, "nobody")
    memory.trust("")
    assert os.environ[SERVICE_USER] == "nobody"
    memory.create_all(system)
    control = segment_name(system.name, "supervisor", "control")
    os.chown(path_of(control), pwd.getpwnam("daemon").pw_uid, -1)
    with pytest.raises(SegmentError, match="belongs to user daemon; accepted are root, nobody"):
        Segment(control)
    memory.trust("daemon")
    Segment(control).close()
    remove_all(system.name)


def test_what_a_stranger_left_is_refused_and_not_touched(system: SystemConfig) -> None:
    memory.create_all(system)
    with of_stranger(system.name):
        before = {path: path.read_bytes() for path in sorted(FOLDER.glob(f"trocar~{system.name}~*"))}
        assert memory.clear_left_over(system.name) == 0
        with pytest.raises(SegmentError, match=f"exists already and belongs to user {STRANGER}"):
            memory.create_all(system)
        assert before == {path: path.read_bytes() for path in sorted(FOLDER.glob(f"trocar~{system.name}~*"))}
        assert left_over(system.name) == []
        with pytest.raises(SegmentError, match=f"belongs to user {STRANGER}; accepted are root and"):
            ControlPage(system.name, "PSM1")
    remove_all(system.name)


def test_systems_of_others_do_not_confuse_the_tools(system: SystemConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.create_all(system)
    with of_stranger(system.name):
        assert system.name not in systems()
        belongs = f"{system.name} belongs to user {STRANGER}"
        with pytest.raises(Problem, match=f"{belongs}; {SERVICE_USER}"):
            chosen_system(system.name)
        monkeypatch.setattr(find, "_permitted", list)  # others may be up on this machine
        with pytest.raises(Problem, match=r"no system is up; .*of (another user is|other users are) there"):
            chosen_system()
    remove_all(system.name)


def test_a_strangers_file_among_ours_is_overlooked(system: SystemConfig) -> None:
    memory.create_all(system)
    ours = names_of(system.name)
    intruder = segment_name(system.name, "PSM9", "state")
    create(intruder, "ring", schema_of(ARM_STATE), 2)
    with of_intruder(intruder):
        assert names_of(system.name) == ours
        assert memory.clear_left_over(system.name) == len(ours)
    unlink(intruder)


@contextlib.contextmanager
def of_intruder(name: str) -> Iterator[None]:
    as_root()
    os.chown(path_of(name), STRANGER, -1)
    yield
    os.chown(path_of(name), 0, -1)


def test_a_held_name_says_who_has_it(system: SystemConfig) -> None:
    with memory.hold_name(system.name):
        with pytest.raises(SegmentError, match=r"is up already \(it is just starting or ending, or another program"):
            memory.hold_name(system.name)
        memory.create_all(system)
        with ControlPage(system.name, "supervisor", write=True).segment as control:
            control.claim("supervisor")
            with pytest.raises(SegmentError, match=rf"\(supervisor pid {os.getpid()}\); trocar down"):
                memory.hold_name(system.name)
        with of_stranger(system.name), pytest.raises(SegmentError, match=f"of user {STRANGER}; choose another name"):
            memory.hold_name(system.name)
    remove_all(system.name)


def test_a_name_that_another_program_holds_confuses_no_tool(world: Any) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as squatter:
        squatter.bind(f"\0trocar~{world.name}")
        with pytest.raises(SegmentError, match="or another program holds its name"):
            memory.hold_name(world.name)
        with pytest.raises(Problem, match="no system"):
            chosen_system(world.name)
    memory.hold_name(world.name).close()


def as_user(name: str, act: Callable[[], object]) -> str:
    """What `act` says, or what it raises, when another user does it: in a fork, which needs no more files."""
    as_root()
    person = pwd.getpwnam(name)
    ear, mouth = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.setgroups([])
            os.setgid(person.pw_gid)
            os.setuid(person.pw_uid)
            reported = str(act())
        except BaseException as error:
            reported = f"{type(error).__name__}: {error}"
        os.write(mouth, reported.encode())
        os._exit(0)
    os.close(mouth)
    with os.fdopen(ear, encoding="utf-8") as heard:
        reported = heard.read()
    os.waitpid(child, 0)
    return reported


def attached(name: str) -> str:
    Segment(name).close()
    return "attached"


@pytest.mark.parametrize("group", ["", "daemon"])
def test_another_user_attaches_only_by_the_group(system: SystemConfig, group: str) -> None:
    as_root()
    memory.create_all(system, memory.maker(group))
    reported = as_user("daemon", lambda: attached(segment_name(system.name, "PSM1", "state")))
    remove_all(system.name)
    refused = "not permitted, it belongs to user root; the system's `group` decides who else may attach"
    assert reported == "attached" if group else refused in reported


def test_a_system_of_another_user_is_seen_when_trusted(system: SystemConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        assert int(as_user("daemon", lambda: memory.create_all(system))) == memory.needed(system)
        assert names_of(system.name) == []
        with pytest.raises(Problem, match="belongs to user daemon"):
            chosen_system(system.name)
        monkeypatch.setenv(SERVICE_USER, "daemon")
        assert chosen_system(system.name) == system.name
    finally:
        for path in FOLDER.glob(f"trocar~{system.name}~*"):
            path.unlink()


def test_a_group_one_is_not_in_is_an_error_at_the_start(system: SystemConfig) -> None:
    reported = as_user("daemon", lambda: memory.create_all(system, memory.maker("root")))
    assert "SegmentError: " in reported
    assert "cannot be given to group 0: Operation not permitted; a member of the" in reported
    assert not list(FOLDER.glob(f"trocar~{system.name}~*"))


def test_what_may_not_be_removed_stops_the_start_plainly(system: SystemConfig) -> None:
    as_root()
    memory.create_all(system)

    def clear() -> int:
        os.environ[SERVICE_USER] = "nobody"
        return memory.clear_left_over(system.name)

    reported = as_user("daemon", clear)
    path = next(path for path in paths(system.name) if path.name.endswith("~document"))
    remove_all(system.name)
    assert reported.startswith("SegmentError: ") and "cannot be removed" in reported
    assert "belongs to user root: its owner, or root, has to remove it" in reported and f"(rm {path})" in reported


@pytest.mark.slow
def test_up_names_the_file_in_its_way_and_whose_it_is(system: SystemConfig, tmp_path: Path) -> None:
    as_root()
    path = path_of(segment_name(system.name, "PSM1", "state"))
    for make in (os.mkfifo, Path.mkdir):
        make(path)
        os.chown(path, STRANGER, -1)
        up = subprocess.run([sys.executable, "-m", "trocar", "up", str(DEMO), "--system", system.name], cwd=ROOT,
                            text=True, capture_output=True, timeout=60, check=False,
                            env={**os.environ, "TROCAR_STATE": str(tmp_path)})
        path.rmdir() if path.is_dir() else path.unlink()
        assert up.returncode == 1 and f"{path.name}: exists already and belongs to user {STRANGER}: " in up.stderr
        assert f"(rm {path})" in up.stderr and names_of(system.name) == []
