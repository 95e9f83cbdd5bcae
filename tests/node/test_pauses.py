"""A process that was held up behaves as if it had been killed and started again; on a clock of numbers."""

from __future__ import annotations

import gc
from argparse import Namespace
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import World
from trocar.procs.arm import loop as arm
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.console import loop as console
from trocar.procs.document.system import Process, SystemConfig
from trocar.procs.io import loop as io
from trocar.procs.node import life, runtime
from trocar.procs.node.node import Node
from trocar.procs.node.pacing import Pauses, duration
from trocar.procs.suj import loop as suj
from trocar.procs.supervisor.memory import create_all
from trocar.procs.system import loop as system
from trocar.procs.teleop import loop as teleop
from trocar.shm.mailbox.client import Client, Reply
from trocar.shm.memory.parts import remove_all
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage

MS = 1_000_000
LIMIT = 30 * MS


class PausedClock:
    """CLOCK_BOOTTIME as the test wants it."""

    def __init__(self) -> None:
        self.now_ns = 7_000_000_000

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def clock() -> PausedClock:
    return PausedClock()


@pytest.mark.parametrize(("late_ns", "reported_ns"), [(0, 0), (-MS, 0), (LIMIT, 0), (LIMIT + 1, LIMIT + 1)])
def test_only_what_is_later_than_planned_by_more_than_the_limit_is_a_pause(
    clock: PausedClock, late_ns: int, reported_ns: int
) -> None:
    pauses = Pauses(LIMIT, clock)
    pauses.begin()
    clock.now_ns += 10 * MS + late_ns
    assert pauses.next(10 * MS) == reported_ns


def test_small_delays_do_not_add_up(clock: PausedClock) -> None:
    pauses = Pauses(LIMIT, clock)
    pauses.begin()
    for _ in range(100):
        clock.now_ns += LIMIT
        assert pauses.next(MS) == 0


def test_a_pause_in_the_middle_of_a_cycle_makes_all_of_it_too_old_until_a_new_beginning(clock: PausedClock) -> None:
    pauses = Pauses(LIMIT, clock)
    pauses.begin()
    clock.now_ns += LIMIT
    assert not pauses.is_over()
    clock.now_ns += 1
    assert pauses.is_over()
    assert pauses.next(0) == LIMIT + 1 and pauses.is_over()
    pauses.end()
    assert not pauses.is_over()
    clock.now_ns += 1000 * MS
    pauses.begin()
    assert pauses.next(0) == 0 and not pauses.is_over()


def test_nothing_is_late_before_the_first_cycle_and_without_a_limit(clock: PausedClock) -> None:
    pauses = Pauses(LIMIT, clock)
    assert not pauses.is_over() and pauses.next(MS) == 0
    never = Pauses(0, clock)
    never.begin()
    clock.now_ns += 10**15
    assert not never.is_over() and never.next(MS) == 0


@pytest.mark.parametrize(("held_up_ms", "words"), [(35, "0.035 s"), (1_540, "1.5 s"), (93_000, "93.0 s")])
def test_a_duration_is_told_in_two_digits_or_tenths(held_up_ms: int, words: str) -> None:
    assert duration(held_up_ms * MS) == words


# a process, with its loop, in the memory of a system whose other processes do not run


def create(file: str, name: str) -> SystemConfig:
    """The memory of a system of this name, with a supervisor that seems to live."""
    loaded = load_system(PROJECT_CONFIGS / "systems" / file, name=name, sets=["clock=wall"])
    assert loaded.system is not None, loaded.errors
    create_all(loaded.system)
    page = ControlPage(name, "supervisor", write=True)
    page.field("heartbeat_ns")[...] = monotonic_ns() + 60_000 * MS
    page.close()
    return loaded.system


@pytest.fixture
def memory(world: World, monkeypatch: pytest.MonkeyPatch, clock: PausedClock) -> Iterator[Callable[[str, str], Node]]:
    """A maker of processes by system file and name; their pauses are those of `clock`."""
    monkeypatch.setattr("trocar.procs.node.node.Pauses", lambda limit_ns: Pauses(limit_ns, clock))
    opened: list[Node] = []

    def make(file: str, name: str) -> Node:
        if not opened:
            opened.append(Node(create(file, world.name), name))
        return opened[0]

    yield make
    for node in opened:
        node.close()
    remove_all(world.name)


class PausedProcess(runtime.Loop):
    """Accepts what it is asked for. In its first life the clock jumps in the middle of the second cycle."""

    lives = 0

    def __init__(self, node: Node, clock: PausedClock, client: Client, sent: list[int]) -> None:
        """`client` asks for two moves: one before the jump, one during it; `sent` is what we send to io meanwhile."""
        super().__init__(node)
        self.clock, self.client, self.sent = clock, client, sent

    def setup(self) -> None:
        PausedProcess.lives += 1
        self.life, self.cycles, node = PausedProcess.lives, 0, self.node
        self.state, self.mailbox, self.io = node.writes("state"), node.mailbox(), node.commands("io")

    def ask_io(self) -> None:
        self.sent.append(self.io.send("power_on", (), "PSM1"))

    def update(self) -> None:
        self.cycles += 1
        for command in self.mailbox.drain(self.node.wall_ns):
            command.accept()
        if self.life == 1 and self.cycles == 1:
            self.client.send("move_jp", (0.1,) * 6)
        elif self.life == 1:
            self.ask_io()
            self.clock.now_ns += 1_500 * MS
            self.ask_io()
            self.client.send("move_jp", (0.2,) * 6)
        elif self.cycles == 3:
            self.node.stop("enough")

    def quit(self) -> None:
        self.ask_io()


@pytest.mark.slow
def test_a_held_up_process_drops_everything_and_begins_anew(
    memory: Callable[[str, str], Node], clock: PausedClock, world: World
) -> None:
    node = memory("kinematic.yaml", "PSM1")
    PausedProcess.lives = 0
    client, sent = Client(world.name, "PSM1"), list[int]()
    state, events = directory.reader(world.name, "PSM1", "state"), directory.reader(world.name, "PSM1", "events")
    runtime.live(node, lambda node: PausedProcess(node, clock, client, sent))
    assert (PausedProcess.lives, state.epoch, node.page.get("pauses"), node.stop_reason) == (2, 2, 1, "enough")
    assert [bool(number) for number in sent] == [True, False, False, True], "nothing of the old cycle is sent"
    held_up = "PSM1 stalled for 1.5 s"
    assert client.poll() == [Reply(1, "accepted", ""), Reply(1, "failed", held_up), Reply(2, "refused", held_up)]
    (row,) = [row for row in events.last(10) if row["code"] == b"held-up"]
    assert (row["text"].decode(), float(row["limit"])) == (held_up, 0.03)
    assert row["value"] == pytest.approx(1.5, abs=0.01)
    for part in (client, state, events):
        part.close()


class TwoLives(runtime.Loop):
    """Held up in its first life, ends in its second."""

    def __init__(self, node: Node, clock: PausedClock, steps: list[str]) -> None:
        super().__init__(node)
        self.clock, self.steps = clock, steps

    def setup(self) -> None:
        self.steps.append("made")

    def update(self) -> None:
        if self.steps.count("made") == 2:
            self.node.stop("enough")
        self.clock.now_ns += 1_500 * MS


@pytest.mark.parametrize(("name", "expected"), [
    ("PSM1", "asks 60, back, made, asks 60, back, made, asks 60"),  # others of its priority run meanwhile
    ("io", "asks 80, made, made"),
])
@pytest.mark.slow
def test_a_loop_is_made_with_the_lowest_priority_unless_a_share_is_reserved(
    world: World, monkeypatch: pytest.MonkeyPatch, clock: PausedClock, name: str, expected: str
) -> None:
    steps: list[str] = []

    def asked(row: Process, clock: str, *, reserved: float) -> list[str]:
        steps.append(f"asks {row.priority}")
        return [f"FIFO {row.priority}"]

    kind = create("kinematic.yaml", world.name).process(name).kind
    monkeypatch.setattr("trocar.procs.node.node.Pauses", lambda limit_ns: Pauses(LIMIT, clock))
    monkeypatch.setattr(runtime, "arguments", lambda kind: Namespace(system=world.name, name=name))
    monkeypatch.setattr(life, "on_stop", lambda stop: None)
    monkeypatch.setattr("trocar.procs.node.node.lock_memory", lambda: "locked")
    monkeypatch.setattr("trocar.procs.node.node.fetch_segments", lambda: None)
    monkeypatch.setattr("trocar.procs.node.node.realtime", asked)
    for module in ("node", "runtime"):
        monkeypatch.setattr(f"trocar.procs.node.{module}.step_back", lambda: steps.append("back"))
    policy: list[bytes] = []

    class Shown(TwoLives):
        def quit(self) -> None:
            policy.append(self.node.page.get("policy"))

    runtime.run(kind, lambda node: Shown(node, clock, steps))
    assert policy[-1].startswith(steps[0].replace("asks", "FIFO").encode())
    remove_all(world.name)
    assert ", ".join(steps) == expected


TELEOP, CART = "kinematic-teleop.yaml", "kinematic-cart.yaml"
LOOPS: dict[str, tuple[str, Callable[[Node], runtime.Loop]]] = {
    "PSM1": (TELEOP, arm.ArmLoop), "MTMR": (TELEOP, arm.ArmLoop), "MTMR_PSM1": (TELEOP, teleop.TeleopLoop),
    "console": (TELEOP, console.ConsoleLoop), "system": (TELEOP, system.SystemLoop), "io": (TELEOP, io.IoLoop),
    "SUJ": (CART, suj.SetupLoop),
}
TURNS = 6  # of all seven: forty


def belongings() -> tuple[int, int]:
    """How many files are open and how many segments mapped."""
    maps = [line for line in Path("/proc/self/maps").read_text().splitlines() if "trocar~" in line]
    return len(list(Path("/proc/self/fd").iterdir())), len(maps)


class OneCycle(runtime.Loop):
    """A loop that is held up after its first cycle."""

    def __init__(self, node: Node, make: Callable[[Node], runtime.Loop], clock: PausedClock,
                 left: Iterator[int]) -> None:
        super().__init__(node)
        self.loop, self.clock, self.left = make(node), clock, left

    def setup(self) -> None:
        self.loop.setup()

    def tick(self) -> bool:
        return self.loop.tick()

    def update(self) -> None:
        self.loop.update()
        self.clock.now_ns += 200 * MS
        if next(self.left, None) is None:
            self.node.stop("enough")

    def quit(self) -> None:
        self.loop.quit()


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.slow
def test_pauses_leak_no_file_no_memory_and_no_place_in_a_mailbox(
    memory: Callable[[str, str], Node], clock: PausedClock, name: str
) -> None:
    file, loop = LOOPS[name]
    node, found = memory(file, name), list[tuple[int, int]]()
    left = iter(range(TURNS))

    def make(node: Node) -> runtime.Loop:
        found.append(belongings())
        return OneCycle(node, loop, clock, left)

    gc.freeze()  # as in a process of its own: what other tests have left is not looked through at each pause
    try:
        runtime.live(node, make)
    finally:
        gc.unfreeze()
    assert len(found) == TURNS + 1 and node.page.get("pauses") == TURNS
    assert len(set(found[1:])) == 1, found
