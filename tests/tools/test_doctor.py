"""`trocar doctor`: what it makes of a machine, and that everything amiss comes with the command that mends it."""

from __future__ import annotations

import ctypes
import json
import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.machine.port_holders import SocketHolder
from trocar.procs.native.library import NativeLibrary
from trocar.procs.node.realtime import CONTAINER, LIMITS_FILE, limits_lines, user
from trocar.shm.memory.segment import names_of, path_of, segment_name
from trocar.tools import cli
from trocar.tools.inspect import machine
from trocar.tools.inspect.machine import BAD, NOTE, OK, Busy, MachineFinding
from trocar.tools.systems.find import other_owner


def file(root: Path, name: str, text: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_the_kernel_is_told_real_time_or_not(tmp_path: Path) -> None:
    assert machine.kernel(tmp_path).state == NOTE
    file(tmp_path, "sys/kernel/realtime", "1\n")
    assert machine.kernel(tmp_path).state == OK


def test_a_machine_on_which_nothing_is_compiled_is_noted_with_what_helps() -> None:
    used = NativeLibrary(ctypes.PyDLL(None), file=Path("/env/native.so"))
    assert machine.compiled(used).state == OK and "/env/native.so" in machine.compiled(used).found
    found = machine.compiled(NativeLibrary(None, "it is not compiled"))
    assert found.state == NOTE and "numpy" in found.found and "trocar.procs.native.build" in found.mend


@pytest.mark.parametrize(("words", "state", "reported"), [
    ("FIFO 90, locked", OK, "FIFO 90"), ("no FIFO, locked", BAD, "no real-time priority for"),
    ("no FIFO, not locked", BAD, "no real-time priority and memory cannot be locked for"),
])
def test_rights_that_are_lacking_come_with_the_file_that_grants_them(
        words: str, state: str, reported: str, tmp_path: Path) -> None:
    found = machine.rights(words, tmp_path)
    assert found.state == state and reported in found.found
    assert ("tee -a /etc/security/limits.d/trocar.conf" in found.mend and "rtprio 98" in found.mend) == (state == BAD)


@pytest.mark.parametrize(("count", "state"), [(1, BAD), (2, NOTE), (machine.GOOD_CORES, OK)])
def test_few_cores_come_with_longer_periods(count: int, state: str) -> None:
    found = machine.cores(count)
    assert found.state == state and str(count) in found.found
    assert ("io.period_s" in found.mend) == (state != OK)


def test_memory_that_a_logout_removes_is_noted_with_the_remedy() -> None:
    assert machine.logout("", "").state == OK
    found = machine.logout("logind removes it", "enable-linger")
    assert found.state == NOTE and (found.found, found.mend) == ("logind removes it", "enable-linger")


def test_a_governor_that_lets_cores_sleep_is_noted(tmp_path: Path) -> None:
    assert machine.governor(tmp_path).state == OK
    for core, name in enumerate(("performance", "powersave")):
        file(tmp_path, f"sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor", name)
    found = machine.governor(tmp_path)
    assert found.state == NOTE and "powersave" in found.found and "scaling_governor" in found.mend
    file(tmp_path, "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "performance")
    assert machine.governor(tmp_path).state == OK


def test_shared_memory_without_room_is_bad(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert machine.shared_memory(tmp_path / "nowhere").state == BAD
    for free_mb, state in ((10, BAD), (100, NOTE), (1000, OK)):
        monkeypatch.setattr(machine.os, "statvfs", lambda _, mb=free_mb: SimpleNamespace(f_bavail=mb, f_frsize=10**6))
        monkeypatch.setattr(machine, "left_over", list)
        assert machine.shared_memory(tmp_path).state == state
    monkeypatch.setattr(machine, "left_over", lambda: ["old"])
    assert machine.shared_memory(tmp_path) == MachineFinding(
        "shared memory", NOTE, f"1000 MB free in {tmp_path}; crashed systems have left:  old",
        "trocar down --system old")


def test_who_has_the_boards_port_is_named() -> None:
    beside = machine.ports([SocketHolder("127.3.4.16", 1394, "me", 7, "boards of system demo", "demo")])
    assert beside.state == OK
    assert "not for boards at 0.0.0.0: boards of system demo (pid 7) has 127.3.4.16" in beside.found
    ours = machine.ports([SocketHolder("0.0.0.0", 1394, "me", 7, "boards of system demo", "demo")])
    assert (ours.state, ours.mend) == (BAD, "trocar down --system demo")  # killed, it would be started again
    found = machine.ports([SocketHolder("0.0.0.0", 1394, "me", 8, "qladisp")])
    assert (found.state, found.mend) == (BAD, "kill 8") and "qladisp (pid 8)" in found.found
    assert "fuser" in machine.ports([SocketHolder("::", 1394, "somebody")]).mend


def test_an_interface_among_the_boards_is_looked_for(tmp_path: Path) -> None:
    assert machine.network({}, tmp_path).state == NOTE
    for name, kind in (("eth0", "1"), ("lo", "772")):
        file(tmp_path, f"sys/class/net/{name}/type", kind)
        file(tmp_path, f"sys/class/net/{name}/operstate", "up")

    def at(address: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(family=SimpleNamespace(name="AF_INET"), address=address)]

    found = machine.network({"eth0": at("10.0.0.2"), "lo": at("127.0.0.1")}, tmp_path)
    assert found.state == NOTE and "eth0 up 10.0.0.2" in found.found and "lo" not in found.found
    assert found.mend == "sudo ip address add 169.254.0.1/16 dev eth0"
    assert machine.network({"eth0": at("169.254.0.1")}, tmp_path).state == OK


def test_rights_that_wait_for_a_login_or_belong_to_a_container_are_told_so(tmp_path: Path) -> None:
    file(tmp_path, LIMITS_FILE[1:], "\n".join(limits_lines(user())))
    assert machine.rights("no FIFO, locked", tmp_path).mend.startswith("log in again")
    file(tmp_path, ".dockerenv", "")
    assert machine.rights("no FIFO, locked", tmp_path).mend == f"docker run {CONTAINER}"


def test_a_firewire_card_is_looked_for(tmp_path: Path) -> None:
    found = machine.firewire(tmp_path)
    assert found.state == NOTE and "no card" in found.found and "firewire-ohci" in found.mend
    file(tmp_path, "dev/fw0", "")
    assert machine.firewire(tmp_path).state == OK


def test_too_few_open_files_are_named_with_the_command_that_allows_more() -> None:
    assert machine.open_files(1024, 4096).state == OK
    assert machine.open_files(64, 4096).state == OK  # a supervisor raises it for itself
    found = machine.open_files(64, 256)
    assert found.state == BAD and "256 files at most" in found.found and "--nofile=1024:1024" in found.mend


def test_busy_programs_are_named_and_our_own_never_slowed() -> None:
    assert machine.free_cpu(3.5, []).state == OK
    hog, own = Busy(99.0, 5, "hog"), Busy(60.0, 6, "IO1", "lab")
    found = machine.free_cpu(0.4, [hog, own, Busy(1.0, 7, "sh")])
    assert (found.state, found.mend) == (BAD, "renice 19 -p 5")
    assert "hog (pid 5) 99 %, IO1 of system lab (pid 6) 60 %" in found.found and "sh" not in found.found.split()
    theirs = machine.free_cpu(0.4, [Busy(99.0, 8, "hog", user="bob"), hog])
    assert theirs.mend == "renice 19 -p 5" and "hog of user bob (pid 8)" in theirs.found
    assert machine.free_cpu(1.4, [own]).mend == "trocar down --system lab"
    assert machine.urgent([(9, "jackd")]) == MachineFinding("other real time", NOTE, "jackd (pid 9)",
                                                            "sudo chrt -o -p 0 9")


def test_whose_a_system_is_is_named_where_another_user_has_to_stop_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "other_owner", {"theirs": "user bob", "ours": ""}.get)
    for name, is_named in (("theirs", True), ("ours", False)):
        monkeypatch.setattr(machine, "left_over", lambda name=name: [name])
        busy = machine.free_cpu(1.4, [Busy(60.0, 6, "IO1", name)])
        assert all(("user bob" in found.mend) == is_named for found in (machine.shared_memory(), busy))


@pytest.mark.skipif(os.getuid() != 0, reason="gives a segment away")
def test_a_system_of_another_user_is_known_as_theirs(world: World) -> None:
    with robot(world.name):
        assert other_owner(world.name) == ""
        for parts in names_of(world.name):
            os.chown(path_of(segment_name(*parts)), 65534, 65534)
        assert other_owner(world.name) == "user nobody"
        for parts in names_of(world.name, foreign=True):
            os.chown(path_of(segment_name(*parts)), 0, 0)


def test_the_verb_prints_one_object_a_finding_and_mends_what_is_amiss() -> None:
    done = CliRunner().invoke(cli.build("doctor"), ["doctor", "--json"])
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert {"kernel", "rights", "cores", "governor", "shared memory", "ports", "network", "free CPU"} <= {
        row["check"] for row in rows}
    assert all(row["mend"] for row in rows if row["state"] != OK) and not any(
        row["mend"] for row in rows if row["state"] == OK)
    assert done.exit_code == int(any(row["state"] == BAD for row in rows))
