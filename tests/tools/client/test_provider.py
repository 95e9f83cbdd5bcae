"""A program of somebody else in its place in a system: what others see of it, and what it is asked for."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import re
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest

import trocar
from tests.conftest import World
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.user_process import UserCommand, UserField, UserProcess
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.node.pacing import Pauses
from trocar.procs.supervisor.memory import clear_left_over, create_all
from trocar.shm.mailbox.client import Client, Reply
from trocar.shm.mailbox.origins import ACTING, NO_ORIGIN
from trocar.shm.memory.parts import remove_all
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.standing import Standing, cells, standings
from trocar.tools.output.errors import Problem, Refused

FOR_NS = 60_000_000_000  # so long a supervisor is there that beats once
QUARTER = ((0.0, -1.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@dataclasses.dataclass
class Place:
    """The memory of a system without its processes."""

    name: str
    ring: RingReader
    events: RingReader
    client: Client

    def value(self, field: str) -> np.ndarray:
        assert self.ring.newest()
        return self.ring.field(field).copy()

    def ask(self, master: trocar.Provider, command: str, values: object = (), text: str = "") -> Reply:
        self.client.send(command, values, text)
        master.serve()
        (reply,) = self.client.poll()
        return reply

    def reported(self) -> list[tuple[str, str, str]]:
        rows = []
        while self.events.next():
            rows.append(tuple(self.events.field(name).item().decode() for name in ("event", "component", "text")))
        return rows

    def beat(self) -> None:
        control_page = ControlPage(self.name, "supervisor", write=True)
        control_page.field("heartbeat_ns")[...] = monotonic_ns() + FOR_NS
        control_page.show("RUNNING")
        control_page.close()


@pytest.fixture
def made(world: World) -> Iterator[Callable[..., Place]]:
    opened: list[Place] = []

    def make(**keys: object) -> Place:
        loaded = load_system(PROJECT_CONFIGS / "systems/third-party-master.yaml", name=world.name)
        assert loaded.system is not None, loaded.errors
        (row,) = loaded.system.third_parties
        system = dataclasses.replace(loaded.system, third_parties=(dataclasses.replace(row, **keys),))  # type: ignore[arg-type]
        create_all(system)
        place = Place(world.name, directory.reader(world.name, "MTMR", "state", "third_party"),
                      directory.reader(world.name, "MTMR", "events", "third_party"), Client(world.name, "MTMR"))
        place.beat()
        opened.append(place)
        return place

    yield make
    for place in opened:
        place.ring.close()
        place.events.close()
        place.client.close()
    remove_all(world.name)


class ProviderClock:
    """CLOCK_BOOTTIME as the test wants it."""

    now_ns = 5_000_000_000

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> ProviderClock:
    made = ProviderClock()
    monkeypatch.setattr("trocar.procs.node.node.Pauses", lambda limit_ns: Pauses(limit_ns, made))
    return made


@pytest.fixture
def place(made: Callable[..., Place], clock: ProviderClock) -> Place:
    """Where a program is never held up, however busy the machine is."""
    return made()


def test_what_is_written_is_what_others_read(place: Place) -> None:
    with trocar.provide("MTMR", place.name, program="mine") as master:
        pose = np.eye(4)
        pose[:3, 3] = 0.1, 0.2, 0.3
        before_ns = monotonic_ns()
        master.write(pose, (0.1, 0, 0, 0, 0, 0.5), gripper=0.4)
        assert place.value("measured_cp").tolist() == [0.1, 0.2, 0.3, 0, 0, 0, 1]
        assert place.value("setpoint_cp").tolist() == [0.1, 0.2, 0.3, 0, 0, 0, 1]
        assert place.value("measured_cv").tolist() == [0.1, 0, 0, 0, 0, 0.5]
        assert place.value("gripper_valid") and place.value("gripper_position") == 0.4
        assert place.value("state").item() == b"ENABLED" and place.value("is_homed")
        assert place.value("program").item() == b"mine" and place.value("tool").item() == b""
        assert before_ns <= place.ring.stamp_ns <= monotonic_ns()
        master.write()
        assert not place.value("reference_valid"), "it does not know where it is"
        master.write((0.1, 0.2, 0.3, 0, 0, 0, 1), jaw=0.2, joints=(0, 0, 0.1, 0))
        assert place.value("reference_valid") and place.value("has_jaw")
        assert place.value("setpoint_position").tolist() == [0, 0, 0.1, 0, 0, 0, 0, 0]


def test_a_base_frame_of_the_file_is_put_on(made: Callable[..., Place]) -> None:
    place = made(base_frame=QUARTER, reference_frame="HRSV")
    with trocar.provide("MTMR", place.name) as master:
        master.write((0.05, 0, 0, 0, 0, 0, 1), (0.1, 0, 0, 0, 0.5, 0))
        assert place.value("measured_cp") == pytest.approx([0.1, 0.05, 0, 0, 0, math.sqrt(0.5), math.sqrt(0.5)])
        assert place.value("measured_cv") == pytest.approx([0, 0.1, 0, -0.5, 0, 0])
        assert place.value("reference_frame").item() == b"HRSV"


@pytest.mark.parametrize(
    "wrong",
    [{"pose": np.zeros((4, 4))}, {"pose": (math.nan, 0, 0, 0, 0, 0, 1)}, {"pose": (0, 0, 0, 0, 0, 0, 0)},
     {"pose": (0, 0, 0)}, {"pose": np.eye(4), "twist": (0, 0)}, {"pose": np.eye(4), "twist": (math.inf,) * 6},
     {"pose": np.eye(4), "gripper": math.nan}, {"pose": np.eye(4), "joints": (0,) * 9}],
)
def test_nonsense_is_no_record(place: Place, wrong: dict[str, object]) -> None:
    with trocar.provide("MTMR", place.name) as master:
        master.write(np.eye(4))
        before = place.ring.newest() and place.ring.sequence
        with pytest.raises(ValueError, match=r"."):
            master.write(**wrong)  # type: ignore[arg-type]
        assert place.ring.newest() and place.ring.sequence == before


def test_the_end_of_a_stream_has_it_hold_but_not_by_the_word_of_another_program(place: Place) -> None:
    held: list[str] = []
    other = Client(place.name, "MTMR", peer=1)
    with trocar.provide("MTMR", system=place.name, commands={
            "servo_cp": lambda values, text: None, "hold": lambda values, text: held.append("hold")}) as master:
        assert place.ask(master, "servo_cp", (0, 0, 0, 0, 0, 0, 1)).outcome == "done"
        other.send("end_stream")
        master.serve()
        assert [reply.outcome for reply in other.poll()] == ["done"] and not held, "it is nothing to others"
        assert place.ask(master, "end_stream").outcome == "done" and held == ["hold"]
    other.close()
    with trocar.provide("MTMR", system=place.name) as master:
        assert place.ask(master, "end_stream").outcome == "done", "it does nothing that could be ended"


def test_stops_of_other_programs_are_counted_for_teleoperations(place: Place) -> None:
    with trocar.provide("MTMR", place.name, commands={"hold": lambda values, text: None}) as master:
        for name, text in (("hold", ""), ("end_stream", ""), ("state_command", "disable"), ("state_command", "home")):
            place.ask(master, name, (), text)
        master.write(np.eye(4))
        assert place.value("stops") == 2, "the end of a stream is not one; a refused stop is"
        assert place.value("stopped_by").item().endswith(b"(state_command)")


def test_the_result_of_a_function_is_the_answer(place: Place) -> None:
    with trocar.provide("MTMR", place.name, commands={"hold": lambda values, text: "it stands"}) as master:
        assert place.ask(master, "hold").text == "it stands"


def test_what_it_does_not_carry_out_is_refused_in_plain_words(place: Place) -> None:
    place.client.send("state_command", (), "disable")  # before anybody was there
    with trocar.provide("MTMR", place.name, program="mine") as master:
        (early,) = place.client.poll()
        assert early.outcome == "refused" and "has just started" in early.text
        reply = place.ask(master, "move_cp", (0, 0, 0, 0, 0, 0, 1))
        assert reply.outcome == "refused"
        assert reply.text == "move_cp: MTMR is mine, a program that does not support move_cp"
        assert place.ask(master, "state_command", (), "home").outcome == "done", "it is"
        assert "does not support state_command disable" in place.ask(master, "state_command", (), "disable").text


def test_what_it_carries_out_gets_the_numbers(place: Place) -> None:
    got: list[object] = []

    def servo_cp(values: np.ndarray, text: str) -> None:
        if values[0] > 1:
            raise Refused("too far")
        got.append(values.tolist())

    with trocar.provide("MTMR", place.name, commands={"servo_cp": servo_cp}) as master:
        assert place.ask(master, "servo_cp", (0.5, 0, 0, 0, 0, 0, 1)).outcome == "done"
        assert place.ask(master, "servo_cp", (2, 0, 0, 0, 0, 0, 1)).text == "servo_cp: too far"
    assert got == [[0.5, 0, 0, 0, 0, 0, 1]]


def test_buttons_are_levels_and_events(place: Place) -> None:
    with trocar.provide("MTMR", place.name) as master:
        place.reported()
        master.press("clutch")
        master.press("clutch")
        master.click("camera")
        with pytest.raises(Problem, match="operator_present"):
            master.press("operator")
        master.write(np.eye(4))
        assert place.value("input").tolist() == [True, False, False]
        assert place.reported() == [("button", "clutch", "pressed"), ("button", "camera", "clicked")]


def test_a_button_wakes_its_console_when_the_record_is_out(place: Place) -> None:
    console = ControlPage(place.name, "console", write=True)
    with trocar.provide("MTMR", place.name) as master:
        for change in (lambda: master.press("operator_present"), lambda: master.click("clutch")):
            console.field("wakeup")[...] = 1  # it sleeps
            master.write(np.eye(4))
            assert console.get("wakeup") == 1, "nothing was pressed"
            change()
            assert console.get("wakeup") == 1, "it would see the old record"
            master.write(np.eye(4))
            assert console.get("wakeup") == 0
    console.close()


@pytest.mark.slow
def test_a_place_is_taken_once_and_a_second_program_hears_at_once_by_whom(place: Place) -> None:
    with trocar.provide("MTMR", place.name, program="recorded") as master:
        for known in ("a program", "program recorded"):
            said = rf"^MTMR: {known} \(pid {os.getpid()}\) has this place already; end it first: kill {os.getpid()}$"
            with pytest.raises(trocar.Problem, match=said):
                trocar.provide("MTMR", place.name, timeout=60.0)
            master.write(np.eye(4))
    with pytest.raises(TimeoutError, match="no place for your own program PSM1; there are: MTMR"):
        trocar.provide("PSM1", place.name, timeout=0.0)
    trocar.provide("MTMR", place.name).close()


def test_a_program_that_hangs_is_not_in_the_way_of_the_next_system(place: Place) -> None:
    with trocar.provide("MTMR", place.name):
        assert clear_left_over(place.name) > 0


def test_wrong_commands_and_rates_are_told_at_once(place: Place) -> None:
    with pytest.raises(ValueError, match="there is no command fly"):
        trocar.provide("MTMR", place.name, commands={"fly": print})
    with pytest.raises(ValueError, match="allowed: 50 to 2000"):
        trocar.provide("MTMR", place.name, rate=10)


def test_status_tells_whether_it_is_attached(place: Place) -> None:
    def shown() -> tuple[str, str]:
        return next((process.kind, process.state) for process in statuses(place.name) if process.name == "MTMR")

    assert shown() == ("third_party", "NOT ATTACHED")
    with trocar.provide("MTMR", place.name) as master:
        master.tick()
        assert shown() == ("third_party", "ATTACHED")
    assert shown() == ("third_party", "DETACHED")


def test_what_a_program_shows_has_an_age_when_it_is_silent_and_none_before_it_came(place: Place) -> None:
    def shown(problem: str = "") -> Standing:
        rows = [dataclasses.replace(row, problem=problem) for row in statuses(place.name) if row.name == "MTMR"]
        return standings(place.name, rows)[0]

    assert cells(shown())[1:] == ("–", "–", "start the program for this arm")
    with trocar.provide("MTMR", place.name) as master:
        master.write(np.eye(4))
        assert cells(shown())[1] == "ENABLED" and re.fullmatch(r"ENABLED, .* s ago", cells(shown("silent"))[1])
    assert shown().reason.startswith("start its program again: "), "it has ended in order"


def test_it_learns_that_the_system_ends(place: Place) -> None:
    with trocar.provide("MTMR", place.name) as master:
        assert master.tick()
        control_page = ControlPage(place.name, "supervisor", write=True)
        control_page.show("STOPPING")
        assert not master.tick()
        control_page.show("RUNNING")
        control_page.field("heartbeat_ns")[...] = monotonic_ns() - 2_000_000_000
        assert not master.tick()
        control_page.close()


def test_states_are_those_of_arms(place: Place) -> None:
    with trocar.provide("MTMR", place.name) as master:
        master.set_state("FAULT", words="cable pulled")
        master.write(np.eye(4))
        assert place.value("state").item() == b"FAULT" and not place.value("is_homed")
        assert "cable pulled" in place.value("sub_state").item().decode()
        assert place.ask(master, "state_command", (), "home").outcome == "refused"
        with pytest.raises(ValueError, match="allowed: DISABLED, ENABLED"):
            master.set_state("HAPPY")


def test_the_page_s_example_runs(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program of docs/third-party-masters.md, ended after three cycles."""
    page = (PROJECT_CONFIGS.parent / "docs/third-party-masters.md").read_text()
    (code, *_) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    cycles = iter((True, True, True, False))
    monkeypatch.setattr(trocar.Provider, "tick", lambda self: next(cycles))
    monkeypatch.setenv("TROCAR_SYSTEM", place.name)
    exec(compile(code, "third-party-masters.md", "exec"), {})
    assert place.value("reference_valid") and place.value("gripper_position") > 0.9
    assert place.ring.sequence == 3


def test_a_stream_of_commands_is_taken_whole(place: Place) -> None:
    got: list[float] = []
    commands: dict[str, trocar.Handler] = {"servo_cp": lambda values, text: got.append(values[0])}
    with trocar.provide("MTMR", place.name, commands=commands) as master:
        for number in range(30):
            place.client.send("servo_cp", (number, 0, 0, 0, 0, 0, 1))
        master.write(np.eye(4))
    assert got == list(range(30))


def test_a_program_that_stalled_restarts(made: Callable[..., Place], clock: ProviderClock) -> None:
    place = made()
    with trocar.provide("MTMR", place.name) as master:
        clock.now_ns += 3_000_000_000  # before the first record nothing is late
        master.write(np.eye(4))
        clock.now_ns += 35_000_000  # 30 ms and a period
        master.write(np.eye(4))
        assert place.ring.epoch == 1 and not master.held_up_s and place.value("reference_valid")
        place.reported()
        place.client.send("state_command", (), "enable")
        clock.now_ns += 1_505_000_000
        master.write(QUARTER)
        assert place.ring.epoch == 2 and master.held_up_s == pytest.approx(1.5)
        words = "MTMR stalled for 1.5 s"
        assert [reply.text for reply in place.client.poll()] == [words]
        assert ("warning", "MTMR", words) in place.reported()
        assert not place.value("reference_valid"), "that pose may be from before the pause"
        master.write(QUARTER)
        assert place.ring.epoch == 2 and not master.held_up_s and place.value("reference_valid")
        assert place.value("measured_cp")[0] == 0.1


def test_a_program_that_stalled_before_its_first_record_is_still_the_same(
        made: Callable[..., Place], clock: ProviderClock) -> None:
    place = made()
    with trocar.provide("MTMR", place.name, program="mine") as master:
        master.set_state("PAUSED")
        assert master.tick()
        clock.now_ns += 501_000_000
        assert master.tick() and master.held_up_s
        master.write(np.eye(4))
        assert place.value("program") == b"mine" and place.value("state") == b"PAUSED"


def test_a_pause_between_two_ticks_is_told_to_the_program(made: Callable[..., Place], clock: ProviderClock) -> None:
    place = made()
    with trocar.provide("MTMR", place.name, rate=1000) as master:
        assert master.tick()
        master.write(np.eye(4))
        clock.now_ns += 501_000_000
        assert master.tick() and master.held_up_s == pytest.approx(0.5)
        master.write(np.eye(4))
        assert place.ring.epoch == 2 and not master.held_up_s and place.value("reference_valid")


@pytest.fixture
def declared(world: World, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """MTMR as a process of the system file, with these commands."""
    def make(*commands: UserCommand) -> None:
        loaded = load_system(PROJECT_CONFIGS / "systems/third-party-master.yaml", name=world.name)
        assert loaded.system is not None
        rows = tuple(dataclasses.replace(row, start="always") if row.name == "MTMR" else row
                     for row in loaded.system.processes)
        create_all(dataclasses.replace(loaded.system, processes=rows, users=(
            UserProcess("MTMR", "mine.py", 0.005, commands=commands),)))
        Place.beat(SimpleNamespace(name=world.name))  # type: ignore[arg-type]

    monkeypatch.setattr(ACTING, "origin", NO_ORIGIN)
    yield make
    remove_all(world.name)


class DeclaredMaster(trocar.Process):
    mode = ""
    master: trocar.Provider

    def setup(self) -> None:
        self.master = trocar.provide(self, commands={"servo_cp": self.go})

    def go(self, values: np.ndarray, text: str) -> None:
        raise Refused("not there")

    def on_mode(self, name: str) -> str:
        self.mode = name
        return f"mode {name}"


def test_a_declared_one_has_commands_of_its_own_besides_those_of_its_place(
        world: World, declared: Callable[..., None]) -> None:
    declared(UserCommand("mode", (UserField("name", "text[20]"),)))
    master = DeclaredMaster(Node(document_of(world.name), "MTMR"))
    ring = directory.reader(world.name, "MTMR", "state")
    master.begin()
    client = Client(world.name, "MTMR")
    for command, values, text in (("mode", (), "fine"), ("servo_cp", (0, 0, 0, 0, 0, 0, 1), ""), ("move_cp", (), "")):
        client.send(command, values, text)
    assert master.tick() and master.mode == "fine"
    replies = [(reply.outcome, reply.text) for reply in client.poll()]
    assert replies == [("done", "mode fine"), ("refused", "servo_cp: not there"),
                       ("refused", "move_cp: MTMR is mine, a program that does not support move_cp")]
    master.master.write(np.eye(4))
    master.master.close()
    assert ring.newest() and ring.field("reference_valid") and master.node.page.state == "RUNNING", "it ends by itself"
    for part in (master.node, ring, client):
        part.close()


def test_a_command_of_every_such_arm_cannot_be_declared_anew(world: World, declared: Callable[..., None]) -> None:
    declared(UserCommand("hold"))
    with (contextlib.closing(Node(document_of(world.name), "MTMR")) as node,
          pytest.raises(ValueError, match="hold: every third_party has this command")):
        DeclaredMaster(node)
