"""A whole system in one process: it homes and moves, the same each time, and leaves nothing behind."""

from __future__ import annotations

import dataclasses
import gc
import itertools
import re
import resource
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import trocar
from tests.host.hosted import COARSE, QUICK, HashedArm, document
from trocar.procs.crtk.topics import find
from trocar.procs.crtk.views import OpenTopic
from trocar.procs.host.host import Host
from trocar.procs.host.loops import HostError
from trocar.procs.tables import codes
from trocar.shm.memory.segment import FOLDER, SegmentError, names_of
from trocar.shm.time.lockstep import EPOCH_NS

GOAL = (0.1, -0.1, 0.12, 0.0, 0.0, 0.0)
BOARDS = ("demo.yaml", "emulated", COARSE)
DESCRIPTORS = Path("/proc/self/fd")
KINEMATIC = ("kinematic.yaml", None, QUICK)


def played() -> str:
    """Home and move once; the hash of all that the arm said."""
    with Host(document(*BOARDS), history=64) as host:
        watched = HashedArm(host)
        watched.homes()
        assert watched.does("move_jp", GOAL) == "done"
        state = host.reader("PSM1")
        assert state.newest() and state.field("is_homed")
        assert max(abs(state.field("position")[:6] - GOAL)) < 2e-3
        return watched.hash


@pytest.mark.slow
def test_an_arm_homes_and_moves_bit_by_bit_the_same_each_time() -> None:
    assert played() == played()


@pytest.mark.slow
def test_time_passes_when_it_is_let_and_not_else() -> None:
    with Host(document(*KINEMATIC)) as host:
        state = host.reader("PSM1")
        assert host.now_ns == EPOCH_NS and not state.newest()
        host.run(0.0109)
        assert host.now_ns == EPOCH_NS + 10_900_000
        assert state.newest() and state.stamp_ns == EPOCH_NS + 9_000_000, "its place is half a period behind io's"
        before = state.head
        host.run(0.0)
        assert state.head == before


def test_time_does_not_go_back_and_ends_with_the_host() -> None:
    with Host(document(*KINEMATIC)) as host:
        host.run(0.01)
        with pytest.raises(HostError, match=r"is 1000010000000 ns, it does not go back to 1000005000000 ns"):
            host.run(-0.005)
        assert host.now_ns == EPOCH_NS + 10_000_000
    with pytest.raises(HostError, match="is closed"):
        host.run(0.01)


def test_an_arm_that_a_script_has_closed_says_so_in_simulated_time_too() -> None:
    one = document(*KINEMATIC)
    with Host(one) as host, host.passing():
        arm = trocar.arm(one.arms[0].name, system=one.name)
        arm.close()
        for call in (arm.connected, arm.measured_jp, arm.operating_state):
            with pytest.raises(trocar.Disconnected, match="is closed"):
                call()


def test_two_hosts_of_a_name_are_refused() -> None:
    one = document(*KINEMATIC)
    with Host(one) as host:
        with pytest.raises(HostError, match=rf"has a host {one.name} already; close that, or give this one another"):
            Host(one)
        host.run(0.01)
    with Host(one) as host:
        host.run(0.01)


def test_a_stream_pauses_in_the_time_of_the_host() -> None:
    with Host(document(*KINEMATIC)) as host:
        client, origins = host.client("PSM1"), []
        for passed in (0.05, 0.09, 0.11, 0.0):
            client.send("servo_jp", GOAL)
            origins.append(client.origin.id)
            host.run(passed)
        assert origins[0] == origins[1] == origins[2] != origins[3]


def test_several_hosts_live_side_by_side() -> None:
    with Host(document(*KINEMATIC), history=64) as first, Host(document(*KINEMATIC), history=64) as second:
        one, other = HashedArm(first), HashedArm(second)
        one.homes()
        assert second.now_ns == EPOCH_NS
        other.homes()
        assert one.hash == other.hash


def test_nothing_of_it_has_a_name_or_is_left() -> None:
    host = Host(document(*BOARDS))
    host.run(0.1)
    assert names_of(host.name) and not list(FOLDER.glob(f"*{host.name}*"))
    host.close()
    assert not names_of(host.name)


@pytest.mark.slow
def test_who_forgets_to_close_it_keeps_no_descriptors() -> None:
    gc.collect()
    before = len(list(DESCRIPTORS.iterdir()))
    host = Host(document(*KINEMATIC))
    host.run(0.02)
    host.snapshot()
    assert len(list(DESCRIPTORS.iterdir())) > before
    name = host.name
    del host
    gc.collect()
    assert len(list(DESCRIPTORS.iterdir())) == before and not names_of(name)


def test_where_descriptors_end_it_says_how_to_have_more() -> None:
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = {int(path.name) for path in DESCRIPTORS.iterdir()}  # not all in a row: others may have ended since
    tenth_free = next(itertools.islice((number for number in itertools.count() if number not in used), 10, None))
    resource.setrlimit(resource.RLIMIT_NOFILE, (tenth_free, limits[1]))
    try:
        with pytest.raises(SegmentError, match=r"Too many open files \(ulimit -n \$"):
            Host(document(*KINEMATIC))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


@pytest.mark.slow
def test_a_master_carries_its_slave() -> None:
    with Host(document("kinematic-teleop.yaml", None, ())) as host:
        assert {"console", "system", "MTMR_PSM1"} <= set(host.loops)
        for arm in ("MTMR", "PSM1"):
            HashedArm(host, arm).homes()
        host.run(0.5)
        state = host.reader("MTMR_PSM1")
        assert state.newest() and state.stamp_ns > host.now_ns - 200_000_000


def test_a_system_in_a_host_is_not_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    player = tmp_path / "aplay"
    player.write_text("#!/bin/sh\n")
    player.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with Host(document("kinematic-teleop.yaml", None, ())) as host:
        host.client("system").send("beep", (0.1, 440.0, 1.0))
        host.run(0.1)
        state = host.reader("system")
        assert state.newest() and state.field("sound")[()] == b"none"


def test_processes_of_users_are_refused_by_name() -> None:
    users: Any = (SimpleNamespace(name="scan"), SimpleNamespace(name="force"))
    with pytest.raises(HostError, match="scan, force: processes of users do not run in a host"):
        Host(dataclasses.replace(document(*KINEMATIC), users=users))
    assert not [name for name in names_of() if name[0].startswith("hosted")]


def test_physics_too_coarse_for_a_wrist_is_refused() -> None:
    coarse = document("demo.yaml", "emulated", ("emulation.period_s=0.005",))
    with pytest.raises(HostError, match=r"PSM1: emulation.period_s is 0.005 s; allowed with a PSM on boards"):
        Host(coarse)
    with Host(document("demo-ecm.yaml", "emulated", ("emulation.period_s=0.005",))) as host:
        host.run(0.02)


def test_what_fails_while_it_begins_leaves_nothing() -> None:
    one = document(*BOARDS)
    assert one.emulation is not None
    elsewhere = tuple(dataclasses.replace(bus, address="127.250.9.9") for bus in one.emulation.buses)
    with pytest.raises(HostError, match="no emulated bus is at"):
        Host(dataclasses.replace(one, emulation=dataclasses.replace(one.emulation, buses=elsewhere)))
    assert not names_of(one.name)


@pytest.mark.slow
def test_a_loop_that_starts_again_refuses_what_waited_and_goes_on() -> None:
    with Host(document(*KINEMATIC), history=64) as host:
        watched = HashedArm(host)
        watched.homes()
        watched.client.send("move_jp", GOAL)
        snapshot = host.snapshot()
        host.restart("PSM1", killed=True)
        watched.run(0.05)
        assert list(watched.outcomes.values())[-1] == "refused"
        assert watched.does("move_jp", GOAL) == "done"
        with pytest.raises(HostError, match="no snapshot of"):
            host.restore(snapshot)
        later = host.snapshot()
        before = watched.hash
        assert watched.does("move_jp", (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)) == "done"
        host.restore(later)
        state = host.reader("PSM1")
        assert state.newest() and max(abs(state.field("position")[:6] - GOAL)) < 2e-3 and watched.hash != before


def test_a_process_that_is_not_there_is_told_with_those_that_are() -> None:
    with Host(document(*KINEMATIC)) as host:
        for ask in (host.client, host.restart, lambda name: host.delay(name, 0.1)):
            with pytest.raises(HostError, match="has no process PSM9; did you mean PSM1"):
                ask("PSM9")


def test_a_loop_without_a_core_comes_later() -> None:
    with Host(document(*KINEMATIC)) as host:
        state = host.reader("PSM1")
        host.run(0.1)
        before = state.head
        host.delay("PSM1", 0.02)
        host.run(0.018)
        assert state.head == before
        host.run(0.01)
        assert state.head > before


@pytest.mark.slow
def test_the_programs_of_the_page_run_as_they_stand(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs/hosts.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for program in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(program, "docs/hosts.md", "exec"), names)
        said = [float(number) for number in re.findall(r"-?\d+\.\d*(?:e-?\d+)?", capsys.readouterr().out)]
        assert said[:6] == pytest.approx(GOAL, abs=2e-3)


def test_the_age_of_a_record_is_that_of_the_systems_time() -> None:
    with Host(document("kinematic.yaml", None)) as host:
        host.run(0.1)
        host.client("PSM1").send("state_command", (), "enable")
        host.run(5.0)
        with (OpenTopic(host.name, find(host.name, "PSM1/state")) as state,
              OpenTopic(host.name, find(host.name, "PSM1/audit")) as audit):
            assert state.newest() and 0.0 <= state.age_s < 0.01
            assert audit.newest() and 1.0 < audit.age_s < 5.0


@pytest.mark.slow
def test_a_robot_whose_stop_was_pressed_during_home_stays_off_when_it_is_released() -> None:
    with Host(document(*BOARDS)) as host:
        host.run(0.1)
        io, boards = host.reader("IO1"), host.client("boards")
        boards.send("emergency_stop", (1.0,))
        host.run(0.1)
        host.client("system").send("home")
        host.run(4.0)
        assert io.newest() and not io.field("power_requested").any()
        assert (io.field("fault") == codes.POWER_TIMEOUT.number).all()
        boards.send("emergency_stop", (0.0,))
        powered = False
        for _ in range(100):
            host.run(0.1)
            assert io.newest()
            powered = powered or bool(io.field("power_requested").any() or io.field("amp_on").any())
        assert not powered, "power needs another command"
