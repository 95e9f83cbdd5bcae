"""A snapshot of a host: what happens after going back to it is what happened, bit by bit, whatever was in between."""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.host.hosted import COARSE, QUICK, document
from trocar.procs.host.host import Host
from trocar.procs.host.loops import HostError
from trocar.procs.host.snapshot import HostSnapshot
from trocar.shm.memory.segment import names_of

NOT_RINGS = ("control", "mailbox", "document", "faults")
REAL = ("monotonic_ns", "local_ns")
"""What the wall clock says, in events and audits."""
GOAL, OTHER = (0.1, -0.1, 0.12, 0.2, 0.0, 0.0), (-0.2, 0.1, 0.15, 0.0, 0.1, 0.0)


class HashedHost:
    """A host all of whose rings are watched."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.arm, self.boards = host.client("PSM1"), host.client("boards") if "boards" in host.loops else None
        rings = [(instance, ring) for _, instance, ring in names_of(host.name)
                 if ring not in NOT_RINGS and instance != "supervisor"]
        self._readers = {(instance, ring): host.reader(instance, ring) for instance, ring in rings}
        self._hash = hashlib.sha256()

    @property
    def state(self) -> str:
        """The arm's."""
        reader = self._readers["PSM1", "state"]
        return bytes(reader.field("state")[()]).decode()

    @property
    def position(self) -> np.ndarray:  # type: ignore[type-arg]
        """The arm's."""
        return self._readers["PSM1", "state"].field("position")[:6]

    def run(self, seconds: float) -> None:
        """Every record that is written goes into the hash."""
        for _ in range(round(seconds / 0.01)):
            self.host.run(0.01)
            for reader in self._readers.values():
                while reader.next():
                    for name in set(REAL) & set(reader.dtype.names or ()):
                        reader.field(name)[...] = 0
                    self._hash.update(reader.record)

    def does(self, word: str, limit_s: float = 60.0) -> None:
        """A state command is done."""
        number, passed = self.arm.send("state_command", (), word), 0.0
        while not any(reply.id == number and reply.outcome == "done" for reply in self.arm.poll()):
            self.run(0.05)
            assert (passed := passed + 0.05) < limit_s, word

    def hash_of(self, play: Callable[[HashedHost], None]) -> str:
        """Of all that is written meanwhile."""
        self._hash = hashlib.sha256()
        play(self)
        assert not any(reader.lost for reader in self._readers.values())
        return self._hash.hexdigest()


def moves(watched: HashedHost) -> None:
    """A move that is bent on its way, and a stream."""
    watched.arm.send("move_jp", GOAL)
    watched.run(0.2)
    watched.arm.send("move_jp", OTHER)
    watched.run(MOVE_S)
    random = np.random.default_rng(3)
    goal = np.array(OTHER)
    for _ in range(8):
        goal = goal + random.uniform(-1e-3, 1e-3, 6)
        watched.arm.send("servo_jp", goal)
        watched.run(0.02)
    assert watched.state == "ENABLED"


def stops(watched: HashedHost) -> None:
    """A fault in the middle of a move, by what is most sudden."""
    watched.arm.send("move_jp", GOAL)
    watched.run(0.2)
    if watched.boards is not None:
        watched.boards.send("emergency_stop", (1.0,))
    else:
        watched.arm.send("state_command", (), "disable")
    watched.run(0.3)
    assert watched.state != "ENABLED"
    watched.arm.send("move_jp", OTHER)
    watched.run(0.1)


SMALL = ("kinematic.yaml", None, QUICK)
MOVE_S = 0.5


def begun(host: Host) -> HashedHost:
    """An arm that is homed."""
    watched = HashedHost(host)
    watched.run(0.05)
    watched.does("enable")
    watched.does("home")
    watched.run(0.2)
    return watched


@pytest.fixture(scope="module", params=["kinematic", "boards"])
def homed(request: pytest.FixtureRequest) -> Iterator[HashedHost]:
    """A homed arm."""
    which: tuple[Any, ...] = SMALL if request.param == "kinematic" else ("demo.yaml", "emulated", COARSE)
    with Host(document(*which), history=64) as host:
        yield begun(host)


@pytest.fixture(scope="module")
def snapshot(homed: HashedHost) -> HostSnapshot:
    """Of it."""
    return homed.host.snapshot()


@pytest.mark.slow
def test_what_happens_after_it_is_the_same_each_time(homed: HashedHost, snapshot: HostSnapshot) -> None:
    homed.host.restore(snapshot)
    first = homed.hash_of(moves)
    assert first != homed.hash_of(moves), "the hash sees where it begins"
    for between in (stops, lambda watched: watched.host.run(3.0)):
        between(homed)
        homed.host.restore(snapshot)
        assert homed.hash_of(moves) == first


@pytest.mark.slow
def test_it_can_be_taken_in_a_move_with_commands_under_way(homed: HashedHost, snapshot: HostSnapshot) -> None:
    homed.host.restore(snapshot)
    homed.arm.send("move_jp", GOAL)
    homed.run(0.2)
    homed.arm.send("move_jp", OTHER)
    amid = homed.host.snapshot()
    first = homed.hash_of(lambda watched: watched.run(0.5))
    homed.host.restore(snapshot)
    stops(homed)
    homed.host.restore(amid)
    assert homed.hash_of(lambda watched: watched.run(0.5)) == first
    homed.run(1.5)
    assert np.allclose(homed.position, OTHER, atol=3e-3)


def test_a_fault_comes_at_the_same_cycle_each_time(homed: HashedHost, snapshot: HostSnapshot) -> None:
    homed.host.restore(snapshot)
    first = homed.hash_of(stops)
    homed.host.restore(snapshot)
    assert homed.hash_of(stops) == first


@pytest.mark.slow
def test_two_hosts_go_the_same_way_whichever_was_restored() -> None:
    with Host(document(*SMALL), history=64) as first, Host(document(*SMALL), history=64) as second:
        one, other = begun(first), begun(second)
        snapshot = first.snapshot()
        assert one.hash_of(moves) == other.hash_of(moves), "taking a snapshot changes nothing"
        late = second.snapshot()
        first.restore(snapshot)
        moves(one)
        second.restore(late)
        assert one.hash_of(moves) == other.hash_of(moves)


@pytest.mark.slow
def test_nothing_grows_with_restores(homed: HashedHost, snapshot: HostSnapshot) -> None:
    def files() -> int:
        gc.collect()
        return len([*Path("/proc/self/fd").iterdir()])

    stops(homed)
    homed.host.restore(snapshot)
    before = files()
    for _ in range(2):
        stops(homed)
        homed.host.restore(snapshot)
    assert files() == before


def test_handles_made_since_begin_anew(homed: HashedHost, snapshot: HostSnapshot) -> None:
    homed.host.restore(snapshot)
    homed.run(1.0)
    reader, client = homed.host.reader("PSM1"), homed.host.client("PSM1")
    number = client.send("move_jp", GOAL)
    homed.run(0.1)
    assert reader.newest()
    homed.host.restore(snapshot)
    assert not client.poll() and not reader.next()
    assert client.send("move_jp", GOAL) <= number
    homed.run(0.1)
    assert reader.next() and not reader.problem and not reader.lost
    assert [reply.outcome for reply in client.poll()] == ["accepted"]


def test_what_nobody_can_put_back_is_named(homed: HashedHost) -> None:
    homed.host.loops["PSM1"].counter = iter([1])  # type: ignore[attr-defined]
    try:
        with pytest.raises(HostError, match=r"loops\['PSM1'\]\.counter is a builtins.list_iterator, and no rule"):
            homed.host.snapshot()
    finally:
        del homed.host.loops["PSM1"].counter  # type: ignore[attr-defined]


def test_a_host_that_is_closed_says_so() -> None:
    with Host(document(*SMALL)) as host:
        snapshot = host.snapshot()
    with pytest.raises(HostError, match="is closed"):
        host.snapshot()
    with pytest.raises(HostError, match="or that is closed"):
        host.restore(snapshot)


def test_a_loop_that_looks_into_another_system_is_refused(homed: HashedHost) -> None:
    with Host(document(*SMALL)) as other:
        homed.host.loops["PSM1"].other = other.reader("PSM1")  # type: ignore[attr-defined]
        try:
            with pytest.raises(HostError, match="is of another system"):
                homed.host.snapshot()
        finally:
            del homed.host.loops["PSM1"].other  # type: ignore[attr-defined]


def test_a_snapshot_of_another_host_is_refused(homed: HashedHost, snapshot: HostSnapshot) -> None:
    with Host(document("kinematic.yaml")) as other:
        with pytest.raises(HostError, match="this is no snapshot of"):
            homed.host.restore(other.snapshot())
        with pytest.raises(HostError, match="this is no snapshot of"):
            other.restore(snapshot)


@pytest.mark.slow
@pytest.mark.parametrize("homed", ["boards"], indirect=True)  # else there is none that could be exchanged
def test_an_instrument_that_was_exchanged_since_is_back_in_its_place(homed: HashedHost, snapshot: HostSnapshot) -> None:
    homed.host.restore(snapshot)
    first = homed.hash_of(moves)
    assert homed.boards is not None
    homed.boards.send("remove_instrument", (), "PSM1")
    homed.run(0.3)
    assert [reply.outcome for reply in homed.boards.poll()][-1:] == ["done"]
    homed.host.restore(snapshot)
    assert homed.hash_of(moves) == first


@pytest.mark.slow
def test_a_master_and_its_slave_are_taken_back_with_their_console() -> None:
    with Host(document("kinematic-teleop.yaml"), history=64) as host:
        watched = begun(host)
        host.client("MTMR").send("state_command", (), "enable")
        host.client("console").send("teleop_enable", (1.0,))
        watched.run(0.5)
        snapshot = host.snapshot()
        first = watched.hash_of(moves)
        watched.does("disable")
        host.restore(snapshot)
        assert watched.hash_of(moves) == first


@pytest.mark.slow
def test_another_seed_is_other_noise_and_the_same_seed_the_same() -> None:
    with Host(document("demo.yaml", "emulated", (*COARSE, "emulation.pot_noise_v=0.001"))) as host:
        watched = HashedHost(host)
        snapshot = host.snapshot()

        def heard(seed: int | None) -> str:
            host.restore(snapshot, seed)
            return watched.hash_of(lambda watched: watched.run(0.1))

        usual, first, other = heard(None), heard(7), heard(8)
        assert len({usual, first, other}) == 3
        assert (heard(None), heard(7), heard(8)) == (usual, first, other)
