"""The base of users' processes, in the memory of a system without its processes."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.conftest import World
from trocar.procs.crtk.topics import catalogue
from trocar.procs.document.system import Process as Row
from trocar.procs.document.system import SystemConfig
from trocar.procs.document.user_process import Property, UserCommand, UserField, UserProcess, UserTopic
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.supervisor.memory import create_all
from trocar.procs.user.process import UserLoop, class_in
from trocar.procs.user.subscription import Subscription
from trocar.shm.mailbox.client import Client, MailboxFull
from trocar.shm.mailbox.mailbox_map import COMMANDS_DEPTH
from trocar.shm.mailbox.origins import ACTING, NO_ORIGIN
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import EVERY, Subscriptions
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.topics import ARM_STATE
from trocar.tools import cli
from trocar.tools.inspect.processes import statuses

FOR_NS = 60_000_000_000  # so long a supervisor is there that beats once
THREE = UserField("force", "float[3]", "N")
DECLARED = UserProcess(
    "mine", "mine.py", 0.001,
    (UserTopic("wrench", 100.0, 16, (THREE, UserField("sensor", "text[8]"))),),
    (UserCommand("go", (THREE, UserField("fast", "bool"), UserField("why", "text[64]"))),
     UserCommand("follow", (UserField("place", "float"),), latest=True), UserCommand("plain", effect="setting")),
    (Property("gain", "float", 1.0, 0.0, 2.0), Property("on", "bool", 0.0), Property("site", "text[8]", words="left")))
OTHER = dataclasses.replace(DECLARED, name="other")


class Mine(UserLoop):
    calls: list[object]

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self.calls = []

    def setup(self) -> None:
        self.calls.append("setup")

    def update(self) -> None:
        self.calls.append("update")
        if self.calls.count("update") == 3:
            self.stop("enough")

    def quit(self) -> None:
        self.calls.append("quit")

    def on_go(self, force: np.ndarray, fast: bool, why: str) -> str:
        self.calls.append((force.tolist(), fast, why))
        return "gone"

    def on_plain(self) -> None:
        raise ValueError("mine is not plain")

    def on_follow(self, place: float) -> None:
        self.calls.append(place)


@pytest.fixture
def make(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Mine]]:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    rows = tuple(Row(user.name, "user", user.period_s) for user in (DECLARED, OTHER))
    create_all(SystemConfig(world.name, "a test", "wall", (), (), None, rows, users=(DECLARED, OTHER)))
    page = ControlPage(world.name, "supervisor", write=True)
    page.field("heartbeat_ns")[...] = monotonic_ns() + FOR_NS
    page.close()
    opened: list[Mine] = []

    def made(kind: type[Mine] = Mine, name: str = "mine") -> Mine:
        opened.append(kind(Node(document_of(world.name), name)))
        return opened[-1]

    yield made
    for process in opened:
        process.node.close()
    world.remove()


@pytest.fixture
def client(world: World, make: Callable[..., Mine]) -> Iterator[Client]:
    made = Client(world.name, "mine")
    yield made
    made.close()


def test_setup_main_and_quit_come_in_order(make: Callable[..., Mine]) -> None:
    mine = make()
    mine.run()
    assert mine.calls == ["setup", "update", "update", "update", "quit"] and mine.stop_reason == "enough"


def test_quit_comes_after_setup_whatever_happens(make: Callable[..., Mine]) -> None:
    class NoSetup(Mine):
        def setup(self) -> None:
            raise OSError("no sensor")

    class NoMain(Mine):
        def main(self) -> None:
            raise ValueError("no more")

    no_setup, no_main = make(NoSetup), make(NoMain, "other")
    with pytest.raises(OSError, match="no sensor"):
        no_setup.run()
    with pytest.raises(ValueError, match="no more"):
        no_main.run()
    assert no_setup.calls == ["quit"] and no_main.calls == ["setup", "quit"]


def test_commands_come_with_typed_arguments(make: Callable[..., Mine], client: Client) -> None:
    mine = make()
    client.send("go", (1, 2, 3, 1), "because")
    client.send("go", (1, 2, 3), "too few")
    client.send("go", (1, 2, 3, 7))
    client.send("plain")
    assert mine.process_messages() == 4
    assert mine.calls == [([1.0, 2.0, 3.0], True, "because")]
    done, refused, neither, nobody = client.poll()
    assert (done.outcome, done.text) == ("done", "gone")
    assert (refused.outcome, refused.text) == ("refused", "go: takes force (3) [N], fast 0|1; 3 given")
    assert (neither.outcome, neither.text) == ("refused", "go: fast 7; allowed: 0|1")
    assert nobody.outcome == "refused" and nobody.text == "mine is not plain"


def test_the_command_line_does_not_send_a_command_without_its_text(make: Callable[..., Mine]) -> None:
    mine = make()
    words = ["send", "mine", "go", "1", "2", "3", "1", "--system", mine.system, "--timeout", "0.01"]
    result = CliRunner().invoke(cli.build("send"), words)
    assert result.exit_code == 2 and "why" in result.stderr
    CliRunner().invoke(cli.build("send"), [*words, ""])
    assert mine.process_messages() == 1 and mine.calls == [([1.0, 2.0, 3.0], True, "")]


def test_what_is_declared_and_has_no_handler_ends_its_setup(make: Callable[..., Mine]) -> None:
    class DeafToFoo(Mine):
        on_follow = None  # type: ignore[assignment]

    mine = make(DeafToFoo)
    with pytest.raises(ValueError, match="DeafToFoo has no on_follow, which mine declares"):
        mine.run()
    assert mine.calls == ["setup", "quit"] and mine.node.page.state == "STARTING"


def test_an_error_of_setup_stays_and_one_that_names_a_command_has_no_other_remedy(make: Callable[..., Mine]) -> None:
    class Forgetful(Mine):
        def setup(self) -> None:
            self.error = "nothing yet: trocar send mine plain"

    mine = make(Forgetful)
    mine.begin()
    assert mine.node.page.state == "RUNNING" and mine.error == "nothing yet: trocar send mine plain"
    mine.error = "no sensor"
    events = directory.reader(mine.system, "mine", "events")
    hints = [row["hint"] for row in events.last(10) if row["event"] == b"error"]
    assert hints[0] == b"" and b"trocar restart mine" in hints[1]
    events.close()


def test_of_setpoints_that_wait_the_latest_wins(make: Callable[..., Mine], client: Client) -> None:
    mine = make()
    for place in (1.0, 2.0, 3.0):
        client.send("follow", (place,))
    client.send("go", (0, 0, 0, 0), "between")
    client.send("follow", (4.0,))
    mine.process_messages()
    assert mine.calls == [3.0, ([0.0, 0.0, 0.0], False, "between"), 4.0]


def test_setpoints_that_find_no_room_cost_the_newest_one_cycle(make: Callable[..., Mine], client: Client) -> None:
    mine, held = make(), COMMANDS_DEPTH
    for place in range(held):
        client.send("follow", (float(place),))
    with pytest.raises(MailboxFull):
        client.send("follow", (float(held),))
    mine.process_messages()
    assert mine.calls == [float(held - 1)], "one is carried out, however many there were"
    client.send("follow", (float(held + 1),))
    mine.process_messages()
    assert mine.calls[-1] == held + 1 and len(mine.calls) == 2


def test_at_most_so_many_messages_are_handled(make: Callable[..., Mine], client: Client) -> None:
    mine = make()
    for _ in range(5):
        client.send("go", (0, 0, 0, 0))
    assert [mine.process_messages(2) for _ in range(4)] == [2, 2, 1, 0]


def test_a_record_of_its_own_is_read_like_any(make: Callable[..., Mine], world: World) -> None:
    mine = make()
    mine.publish("wrench", force=(1, 2, 3), sensor="left")
    reader = directory.reader(world.name, "mine", "wrench")
    assert reader.newest() and reader.field("force").tolist() == [1, 2, 3] and reader.field("sensor").item() == b"left"
    listed = {entry.name: entry for entry in catalogue(world.name)}
    assert listed["mine/wrench"].fields[0].unit == "N" and "mine/properties" in listed
    reader.close()


def test_a_subscribed_record_ends_a_wait(make: Callable[..., Mine]) -> None:
    mine, other = make(), make(name="other")
    wrench: Subscription = mine.subscribe("other/wrench")
    assert wrench.slice_ns == 5_000_000, "of 100 Hz, half a period"
    mine.node.begin()
    assert mine.wait(0.0) and not mine.has_news()
    other.publish("wrench", force=(4, 5, 6))
    assert mine.wait(30.0) and wrench.has_news and wrench.look() and wrench["force"].tolist() == [4, 5, 6]
    assert not mine.has_news()


def test_it_knows_whether_somebody_wants_a_topic(make: Callable[..., Mine]) -> None:
    mine, other = make(), make(name="other")
    assert not other.is_wanted("wrench")
    wrench = mine.subscribe("other/wrench")
    assert other.is_wanted("wrench") and not other.is_wanted("properties")
    mine.unsubscribe(wrench)
    assert not other.is_wanted("wrench")


def test_what_is_computed_on_demand_is_wanted_by_its_group(make: Callable[..., Mine], world: World) -> None:
    mine = make()
    create_control(world.name, "PSM1", topics=(ARM_STATE,))
    directory.create_ring(world.name, "PSM1", ARM_STATE, {}, {"kind": "arm"})
    page = ControlPage(world.name, "PSM1")
    arm = Subscriptions(page)
    state = mine.subscribe("PSM1/state", "wrench")
    assert arm.look() and arm.wanted == arm.bits("state") | arm.bits("state", "wrench") | EVERY
    mine.unsubscribe(state)
    assert arm.look() and not arm.wanted
    with pytest.raises(SegmentError, match="no state/colour to subscribe to"):
        mine.subscribe("PSM1/state", "colour")
    page.close()


def test_a_watched_file_ends_a_wait(make: Callable[..., Mine]) -> None:
    mine = make()
    reading, writing = os.pipe()
    mine.watch(reading)
    mine.node.begin()
    assert mine.wait(0.0) and not mine.is_ready(reading)
    os.write(writing, b"x")
    assert mine.wait(30.0) and mine.is_ready(reading)
    mine.unwatch(reading)
    assert mine.wait(0.0) and not mine.is_ready(reading)
    os.close(reading)
    os.close(writing)


def test_a_watched_file_is_ready_as_long_as_something_waits_in_it(make: Callable[..., Mine]) -> None:
    mine = make()
    reading, writing = os.pipe()
    mine.watch(reading)
    mine.node.begin()
    os.write(writing, b"xy")
    assert mine.is_ready(reading)  # who has an update and waits for nothing sees it, too
    assert mine.wait(30.0) and os.read(reading, 1) == b"x" and mine.is_ready(reading)
    assert os.read(reading, 1) == b"y" and not mine.is_ready(reading) and not mine.has_news()
    mine.unwatch(reading)
    os.close(reading)
    os.close(writing)


def test_properties_are_set_within_bounds_and_saved(make: Callable[..., Mine], client: Client, world: World,
                                                    tmp_path: Path) -> None:
    mine = make()
    for value in (1.5, 2.5):
        client.send("set_property", (value,), "gain")
    client.send("set_property", (1,), "nothing")
    client.send("save_properties")
    mine.process_messages()
    assert [reply.outcome for reply in client.poll()] == ["done", "refused", "refused", "done"]
    assert mine.properties["gain"] == 1.5
    reader = directory.reader(world.name, "mine", "properties")
    assert reader.newest() and reader.field("gain").item() == 1.5
    reader.close()
    saved = tmp_path / world.name / "mine.properties.json"
    assert json.loads(saved.read_text()) == {"gain": 1.5, "on": 0.0, "site": "left"}
    (tmp_path / world.name / "other.properties.json").write_text('{"gain": 0.5, "gone": 1}')
    assert make(name="other").properties["gain"] == 0.5


def test_texts_are_properties_of_so_many_bytes(make: Callable[..., Mine], client: Client, world: World, tmp_path: Path
                                               ) -> None:
    mine = make()
    reader = directory.reader(world.name, "mine", "properties")
    assert reader.newest() and reader.field("site").item() == b"left"
    client.send("set_property", (), "site far left")
    mine.process_messages()
    assert mine.properties["site"] == "far left" and reader.newest() and reader.field("site").item() == b"far left"
    for text, values in (("site much too long", ()), ("site 1", (1.0,)), ("gain 1", ()), ("site", ())):
        client.send("set_property", values, text)
        mine.process_messages()
    assert [reply.outcome for reply in client.poll()] == ["done", "refused", "refused", "refused", "done"]
    assert mine.properties["site"] == ""
    reader.close()
    (tmp_path / world.name).mkdir()
    (tmp_path / world.name / "other.properties.json").write_text('{"site": "far right of it", "gain": 2}')
    assert dict(make(name="other").properties) == {"gain": 2.0, "on": 0.0, "site": "left"}


def test_its_error_is_shown_until_it_is_over(make: Callable[..., Mine], world: World) -> None:
    mine = make()
    mine.node.begin()
    mine.wait(0.0)
    mine.error = "no data"
    assert [row.problem for row in statuses(world.name) if row.name == "mine"] == ["no data"]
    mine.error = ""
    assert mine.error == "" and [row.problem for row in statuses(world.name) if row.name == "mine"] == [""]


def test_it_acts_for_nobody_until_a_command_that_moves(make: Callable[..., Mine], client: Client, world: World,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    mine, theirs = make(), make(name="other")
    client.send("go", (0, 0, 0, 0))
    asked = client.origin
    monkeypatch.setattr(ACTING, "origin", NO_ORIGIN)
    to_other = Client(world.name, "other")
    to_other.send("go", (0, 0, 0, 0))
    assert to_other.origin == NO_ORIGIN
    mine.process_messages()
    to_other.send("go", (0, 0, 0, 0))
    assert to_other.origin == asked
    monkeypatch.setattr(ACTING, "system", "another")
    to_other.send("go", (0, 0, 0, 0))
    assert to_other.origin == NO_ORIGIN, "an operator of one system is none of another"
    to_other.close()
    assert theirs.process_messages() == 3


def test_who_subscribes_to_what_is_not_there_is_told_what_is(make: Callable[..., Mine]) -> None:
    mine = make()
    for topic, told in (("nobody/wrench", "no process nobody; there are: supervisor, mine, other"),
                        ("othr/wrench", r"no process othr; did you mean other\?"),
                        ("other/force", "other has no force to subscribe to; it has: .*wrench")):
        with pytest.raises(SegmentError, match=told):
            mine.subscribe(topic)


def test_a_name_that_is_not_there_is_told_with_those_that_are(make: Callable[..., Mine]) -> None:
    mine, other = make(), make(name="other")
    wrench = mine.subscribe("other/wrench")
    other.publish("wrench", force=(1, 2, 3))
    assert wrench.look() and wrench["force"].tolist() == [1, 2, 3]
    tries: list[tuple[Callable[[], object], str]] = [
        (lambda: mine.publish("wrench", forces=(1, 2, 3)), "mine/wrench has no field forces; did you mean force?"),
        (lambda: mine.publish("wrensh", force=(1, 2, 3)), "mine has no topic wrensh; did you mean wrench?"),
        (lambda: mine.properties["gian"], "no property gian; there are gain, on, site"),
        (lambda: wrench["pull"], "other/wrench has no field pull; it has: ")]
    for do, told in tries:
        with pytest.raises(KeyError, match=re.escape(told)):
            do()
    assert "gian" not in mine.properties


@pytest.mark.parametrize(("value", "told"), [((1, 2, 3, 4), "could not broadcast"), ("north", "could not convert")])
def test_a_value_that_does_not_fit_is_told_with_its_field(make: Callable[..., Mine], value: object, told: str) -> None:
    with pytest.raises(ValueError, match=f"mine/wrench, field force: {told}"):
        make().publish("wrench", force=value)


def test_a_module_has_one_class_or_a_function(tmp_path: Path) -> None:
    file = tmp_path / "lab_process_of_a_test.py"
    file.write_text("def main(process): process.calls = 'main'\n")
    assert issubclass(class_in(str(file)), UserLoop)
    file.write_text("import trocar\n")
    with pytest.raises(ImportError, match="0 subclasses"):
        class_in(str(file))


def test_the_page_names_tests_that_are_there() -> None:
    root = Path(__file__).resolve().parents[2]
    page = (root / "docs/write-a-process.md").read_text()
    named = [part.split("`")[0] for part in page.split("`tests/")[1:]]
    for name in named:
        file, _, test = name.partition("::")
        assert not test or f"def {test}(" in (root / "tests" / file).read_text(), name
