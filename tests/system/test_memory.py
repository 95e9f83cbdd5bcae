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
from trocar.procs.supervisor import memory
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.owners import SERVICE_USER
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
from trocar.shm.system.directory import systems
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.lockstep import Timekeeper
from trocar.shm.topics import ARM_STATE
from trocar.tools.output.errors import Problem
from trocar.tools.systems import find
from trocar.tools.systems.find import chosen_system, left_over

pytestmark = pytest.mark.patient
STRANGER = 4242
IN_A_SMALL_ONE = """
mount -t tmpfs -o size={size} tmpfs /dev/shm || exit 99
{command}
code=$?
echo "left: $(ls -A /dev/shm)"
exit $code
"""


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
    memory.remove_all(system.name)


def test_the_clock_of_a_lock_step_counts_too(system: SystemConfig) -> None:
    simulated = dataclasses.replace(system, clock="lockstep")
    total = memory.create_all(simulated)
    keeper = Timekeeper(system.name, memory.simulated(simulated))
    keeper.close()
    memory.remove_all(system.name)
    assert memory.needed(simulated) == total + keeper.size


def test_too_little_room_is_said_before_anything_is_made(system: SystemConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*arguments: object) -> int:
        raise AssertionError("made")

    needed = memory.needed(system)
    monkeypatch.setattr(memory, "free_bytes", lambda system: needed - 1)
    with pytest.raises(SegmentFull) as caught:
        memory.create_all(system, never)
    reported = str(caught.value)
    assert "\n" not in reported and f"needs {needed / 1e6:.1f} MB" in reported and "are free in /dev/shm" in reported
    assert "trocar down" in reported and "mount -o remount,size=" in reported
    monkeypatch.setattr(memory, "free_bytes", lambda system: needed)
    memory.create_all(system)
    memory.remove_all(system.name)


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


def in_small_memory(size: int, command: str, state: Path) -> subprocess.CompletedProcess[str]:
    """Run a command where /dev/shm is a small file system of its own."""
    allowed = subprocess.run(["unshare", "-m", "--propagation", "private", "true"], capture_output=True, check=False)
    if allowed.returncode:
        pytest.skip("a mount namespace of one's own is not permitted here")
    script = IN_A_SMALL_ONE.format(size=size, command=command)
    done = subprocess.run(["unshare", "-m", "--propagation", "private", "sh", "-c", script], cwd=ROOT, text=True,
                          capture_output=True, timeout=120, check=False, env={**os.environ, "TROCAR_STATE": str(state)})
    if done.returncode == 99:
        pytest.skip("mounting is not permitted here")
    return done


@pytest.mark.slow
def test_up_in_a_full_shared_memory_says_what_to_do(system: SystemConfig, tmp_path: Path) -> None:
    needed = memory.needed(system)
    up = f"{sys.executable} -m trocar up {DEMO} --system {system.name} --clock wall --for 0.1"
    done = in_small_memory(needed - 4096, up, tmp_path)
    assert done.returncode == 1, done.stderr
    assert f"shared memory is full: system {system.name} needs {needed / 1e6:.1f} MB, " in done.stderr
    assert "Traceback" not in done.stderr and done.stdout == "left: \n"


@pytest.mark.slow
def test_up_fits_into_exactly_what_it_says(system: SystemConfig, tmp_path: Path) -> None:
    needed = memory.needed(dataclasses.replace(system, clock="paced"))
    up = f"{sys.executable} -m trocar up {DEMO} --system {system.name} --clock paced --for 0.1"
    done = in_small_memory(needed, up, tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"system {system.name}: {needed / 1e6:.1f} MB of shared memory" in done.stderr
    assert done.stdout == "left: \n"


@pytest.mark.slow
@pytest.mark.parametrize("megabytes", [0, 1, 3])
def test_memory_another_program_takes_meanwhile_is_no_harm(tmp_path: Path, world: Any, megabytes: int) -> None:
    code = ('from trocar.procs.config import load_system; from trocar.procs.supervisor import memory\n'
            'memory.free_bytes = lambda system: 1 << 40\n'
            f'memory.create_all(load_system("{DEMO}", name="{world.name}").system)')
    done = in_small_memory((megabytes << 20) + 8192, f"{sys.executable} -c '{code}'", tmp_path)
    assert "SegmentFull: shared memory is full: system" in done.stderr and done.stdout == "left: \n"


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
    memory.remove_all(system.name)
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
    memory.remove_all(system.name)


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
    memory.remove_all(system.name)


def test_systems_of_others_do_not_confuse_the_tools(system: SystemConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.create_all(system)
    with of_stranger(system.name):
        assert system.name not in systems()
        belongs = f"{system.name} belongs to user {STRANGER}"
        with pytest.raises(Problem, match=f"not permitted: system {belongs}; {SERVICE_USER} names a user"):
            chosen_system(system.name)
        monkeypatch.setattr(find, "_permitted", list)  # others may be up on this machine
        with pytest.raises(Problem, match=f"no system is up; .*{belongs}"):
            chosen_system()
    memory.remove_all(system.name)


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
    memory.remove_all(system.name)


def test_a_name_somebody_else_holds_confuses_no_tool(world: Any) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as squatter:
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
    memory.remove_all(system.name)
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
    path = paths(system.name)[0]
    memory.remove_all(system.name)
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
