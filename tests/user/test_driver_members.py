"""What Player's drivers do by members of ThreadedDriver and Driver, done by ours: one test for each."""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest

from tests.conftest import World
from tests.user.test_process import Mine
from tests.user.test_process import client as client  # fixtures
from tests.user.test_process import make as make
from trocar.shm.mailbox.client import Client
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns

Make = Callable[..., Mine]


def told(world: World, *events: bytes) -> list[tuple[str, str]]:
    """(event, text) of those in the ring of the process."""
    reader = directory.reader(world.name, "mine", "events")
    rows = [(row["event"].decode(), row["text"].decode()) for row in reader.last(100) if row["event"] in events]
    reader.close()
    return rows


def test_main_is_its_work_until_it_returns(make: Make) -> None:
    class OwnMain(Mine):
        def main(self) -> None:
            while self.tick() and self.calls.count("main") < 2:
                self.calls.append("main")

    mine = make(OwnMain)
    mine.run()
    assert mine.calls == ["setup", "main", "main", "quit"] and mine.stop_reason == ""


def test_without_a_main_the_update_is_called_once_a_period(make: Make) -> None:
    mine = make()
    begin = monotonic_ns()
    mine.run()
    assert mine.calls.count("update") == 3 and monotonic_ns() - begin >= 2_500_000  # of 1 ms each


def test_who_is_asked_to_end_learns_it_in_tick_and_wait(make: Make) -> None:
    mine = make()
    mine.begin()
    assert mine.tick() and mine.wait(0.0)
    mine.stop("asked to stop")
    begin = monotonic_ns()
    assert not mine.tick() and not mine.wait(30.0) and monotonic_ns() - begin < 5_000_000_000
    assert mine.stop_reason == "asked to stop"


def test_a_stop_ends_a_wait_that_has_begun(make: Make) -> None:
    class Stopping(Mine):
        def on_follow(self, place: float) -> None:
            self.stop("a command said so")

    mine = make(Stopping)
    mine.begin()
    sender = Client(mine.system, "mine")
    sender.send("follow", (1.0,))
    assert mine.wait(30.0), "there is news"
    mine.process_messages()
    assert not mine.wait(30.0)
    sender.close()


def test_quit_comes_when_it_was_asked_to_end(make: Make) -> None:
    class WaitingMain(Mine):
        def main(self) -> None:
            self.stop("asked to stop")
            while self.wait(30.0):
                self.calls.append("never")

    mine = make(WaitingMain)
    mine.run()
    assert mine.calls == ["setup", "quit"]


def test_a_wait_ends_by_its_time(make: Make) -> None:
    mine = make()
    mine.begin()
    begin = monotonic_ns()
    assert mine.wait(0.02) and monotonic_ns() - begin >= 20_000_000


def test_a_file_that_is_not_watched_any_more_is_no_news(make: Make) -> None:
    mine = make()
    reading, writing = os.pipe()
    mine.begin()
    mine.watch(reading)
    os.write(writing, b"x")
    assert mine.has_news()
    mine.unwatch(reading)
    assert not mine.has_news()
    os.close(reading)
    os.close(writing)


def test_an_answer_goes_to_who_has_asked(make: Make, client: Client) -> None:
    mine = make()
    other = Client(mine.system, "mine")
    client.send("go", (0, 0, 0, 0))
    other.send("plain")
    mine.process_messages()
    assert [reply.outcome for reply in client.poll()] == ["done"]
    assert [reply.outcome for reply in other.poll()] == ["refused"]
    other.close()


def test_an_answer_may_come_later(make: Make, client: Client) -> None:
    class AnswersLater(Mine):
        def on_follow(self, place: float) -> object:
            self.kept = self.request
            return self.LATER

    mine = make(AnswersLater)
    client.send("follow", (1.0,))
    mine.process_messages()
    assert [reply.outcome for reply in client.poll()] == ["accepted"]
    mine.kept.done("there")  # type: ignore[attr-defined]
    assert [(reply.outcome, reply.text) for reply in client.poll()] == [("done", "there")]


def test_an_event_is_for_whoever_looks(make: Make, world: World) -> None:
    mine = make()
    mine.event("touched", "left jaw", 2.5)
    mine.status("ready")
    assert told(world, b"touched", b"status") == [("touched", "left jaw"), ("status", "mine: ready")]


def test_a_record_says_what_the_last_one_said_where_nothing_is_given(make: Make, world: World) -> None:
    mine = make()
    mine.publish("wrench", force=(1, 2, 3), sensor="left")
    mine.publish("wrench", sensor="right")
    reader = directory.reader(world.name, "mine", "wrench")
    assert reader.newest() and reader.field("force").tolist() == [1, 2, 3] and reader.head == 2
    assert reader.field("sensor").item() == b"right"
    reader.close()


def test_a_handler_that_fails_is_refused_and_the_next_is_carried_out(make: Make, client: Client) -> None:
    class Failing(Mine):
        def on_plain(self) -> None:
            raise ZeroDivisionError("no more")

        def on_follow(self, place: float) -> None:
            raise ValueError("too far")

    mine = make(Failing)
    client.send("plain")
    client.send("go", (0, 0, 0, 0))
    assert mine.process_messages() == 2
    refused, done = client.poll()
    assert (refused.outcome, refused.text) == ("refused", "ZeroDivisionError: no more") and done.outcome == "done"
    client.send("follow", (1.0,))
    mine.process_messages()
    assert [reply.outcome for reply in client.poll()] == ["accepted", "failed"], "a setpoint is accepted before"


def test_commands_of_every_process_are_carried_out_by_the_base(make: Make, client: Client) -> None:
    class Tuned(Mine):
        def property_changed(self, name: str) -> str:
            return f"{name} is {self.properties[name]:g}"

    mine = make(Tuned)
    client.send("set_property", (0.5,), "gain")
    mine.process_messages()
    assert [reply.text for reply in client.poll()] == ["gain is 0.5"]


def test_what_waits_is_news_until_it_is_carried_out(make: Make, client: Client) -> None:
    mine = make()
    mine.begin()
    assert not mine.has_news()
    client.send("go", (0, 0, 0, 0))
    assert mine.has_news() and mine.wait(30.0)
    mine.process_messages()
    assert not mine.has_news()


def test_what_is_unsubscribed_is_no_news(make: Make) -> None:
    mine, other = make(), make(name="other")
    mine.begin()
    wrench = mine.subscribe("other/wrench")
    mine.unsubscribe(wrench)
    other.publish("wrench", force=(4, 5, 6))
    assert not mine.has_news()


def test_records_in_order_are_read_from_the_ring(make: Make, world: World) -> None:
    mine, other = make(), make(name="other")
    wrench = mine.subscribe("other/wrench")
    for x in range(5):
        other.publish("wrench", force=(x, 0, 0))
    seen = []
    while wrench.ring.next():
        seen.append(float(wrench.ring.field("force")[0]))
    assert seen == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_its_error_can_be_read_back_and_is_told_once(make: Make, world: World) -> None:
    mine = make()
    for _ in range(3):
        mine.error = "no data"
    assert mine.error == "no data" and told(world, b"error") == [("error", "mine: no data")]


def test_its_place_is_taken_once(make: Make) -> None:
    make()
    with pytest.raises(SegmentError, match="mine"):
        make()


def test_its_topics_are_wanted_one_by_one(make: Make) -> None:
    mine, other = make(), make(name="other")
    mine.subscribe("other/properties")
    assert other.is_wanted("properties") and not other.is_wanted("wrench")


@pytest.mark.parametrize("name", ["node", "time", "log", "rest_periods", "status", "_files"])
def test_a_program_cannot_replace_an_attribute_of_every_process(make: Make, name: str) -> None:
    mine = make()
    with pytest.raises(AttributeError, match=f"self.{name}: every trocar.Process has an attribute of this name"):
        setattr(mine, name, None)
    mine.run()
    with pytest.raises(ValueError, match=f"Taken.{name}: every trocar.Process has an attribute of this name"):
        make(type("Taken", (Mine,), {name: None, "__module__": "box"}), "other")
