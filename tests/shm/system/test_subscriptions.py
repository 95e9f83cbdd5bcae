"""Subscriptions: what anybody alive wants is wanted, what the dead wanted is cleared, and a change is seen at once."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tests.conftest import World
from tests.examples import examples
from trocar.shm.memory.locks import AllTaken
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.rows import Field, Topic
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system.subscriptions import CELLS, EVERY, Cells, Clearing, Subscriber, Subscriptions
from trocar.shm.time.control_page import SUBSCRIBERS, ControlPage, create_control
from trocar.shm.topics import EVENTS

STATE = Topic("state", "arm", rate_hz=100, depth=100, fields=(
    Field("valid", "?", "", ""), Field("force", "<f8", "N", "", "wrench"),
    Field("torque", "<f8", "N·m", "", "wrench"), Field("columns", "<f8", "", "", "jacobian")))
WANTED = ["state", "state/wrench", "state/jacobian", "events"]


@pytest.fixture
def system(world: World) -> Iterator[str]:
    create_control(world.name, "PSM1", topics=(STATE, EVENTS))
    yield world.name
    world.remove()


class Instance:
    """The instance's end and the supervisor's, each with a page of its own."""

    def __init__(self, system: str) -> None:
        self.pages = [ControlPage(system, "PSM1", write=True) for _ in range(2)]
        self.subscriptions, self.clearing = Subscriptions(self.pages[0]), Clearing(self.pages[1])

    def wanted(self) -> list[str]:
        self.subscriptions.look()
        return [name for bit, name in enumerate(WANTED) if self.subscriptions.wanted >> bit & 1]

    def close(self) -> None:
        for page in self.pages:
            page.close()


@pytest.fixture
def instance(system: str) -> Iterator[Instance]:
    ends = Instance(system)
    yield ends
    ends.close()


def die(subscriber: Subscriber) -> None:
    """As far as others can see, it was killed: its file is closed, its cell is as it was."""
    subscriber._page.close()


def test_a_reader_of_every_record_says_so_as_long_as_it_wants_any(system: str, instance: Instance) -> None:
    some, all_of_them = Subscriber(system, "PSM1"), Subscriber(system, "PSM1", every=True)
    some.want("state")
    assert instance.wanted() == ["state"] and not instance.subscriptions.wanted & EVERY
    all_of_them.want("state", "wrench")
    assert instance.wanted() == ["state", "state/wrench"] and instance.subscriptions.wanted & EVERY
    all_of_them.drop("state", "wrench")
    assert instance.wanted() == ["state"] and instance.subscriptions.wanted & EVERY
    all_of_them.drop("state")
    assert instance.wanted() == ["state"] and not instance.subscriptions.wanted & EVERY
    some.close()
    all_of_them.close()


def test_the_page_lists_topics_and_groups_in_the_order_of_their_bits(system: str) -> None:
    page = ControlPage(system, "PSM1")
    assert page.segment.header.info["wanted"] == WANTED
    page.close()


def test_nothing_is_wanted_of_who_has_no_subscriber(instance: Instance) -> None:
    assert not instance.subscriptions.look() and instance.subscriptions.wanted == 0


def test_who_wants_a_group_wants_its_topic_until_it_goes(system: str, instance: Instance) -> None:
    subscriber = Subscriber(system, "PSM1")
    subscriber.want("state", "wrench")
    assert instance.subscriptions.look() and not instance.subscriptions.look()
    assert instance.wanted() == ["state", "state/wrench"]
    subscriber.close()
    assert instance.subscriptions.look() and instance.wanted() == []


def test_a_dropped_group_leaves_the_topic_and_a_dropped_topic_leaves_nothing(system: str, instance: Instance) -> None:
    subscriber = Subscriber(system, "PSM1")
    subscriber.want("state", "wrench", "jacobian")
    subscriber.want("events")
    subscriber.drop("state", "wrench")
    assert instance.wanted() == ["state", "state/jacobian", "events"]
    subscriber.drop("state")
    assert instance.wanted() == ["events"]
    subscriber.close()


def test_what_two_want_stays_until_both_have_dropped_it(system: str, instance: Instance) -> None:
    one, other = (Subscriber(system, "PSM1") for _ in range(2))
    for subscriber in (one, other):
        subscriber.want("state", "wrench")
    one.drop("state", "wrench")
    assert "state/wrench" in instance.wanted()
    other.close()
    assert instance.wanted() == ["state"]
    one.close()


def test_bits_are_those_of_the_group_alone(instance: Instance) -> None:
    bits = instance.subscriptions.bits
    assert [bits("state"), bits("state", "wrench"), bits("events")] == [1, 2, 8]


@pytest.mark.parametrize(("topic", "group", "called"), [("gains", "", "gains"), ("state", "colour", "state/colour")])
def test_what_nobody_has_cannot_be_wanted(system: str, topic: str, group: str, called: str) -> None:
    subscriber = Subscriber(system, "PSM1")
    with pytest.raises(SegmentError, match=f"PSM1 has no {called} to subscribe to; it has: state, "):
        subscriber.want(topic, group)
    subscriber.close()


def test_an_absent_instance_has_no_subscribers(system: str) -> None:
    with pytest.raises(SegmentError, match="no such segment"):
        Subscriber(system, "PSM9")


def test_more_things_than_bits_are_refused_at_the_start(world: World) -> None:
    topic = Topic("state", "arm", rate_hz=100, depth=100,
                  fields=tuple(Field(f"f{i}", "?", "", "", f"g{i}") for i in range(64)))
    with pytest.raises(SegmentError, match="65 topics and groups of fields; allowed are 63"):
        create_control(world.name, "PSM1", topics=(topic,))


def test_the_dead_want_nothing_once_their_places_were_cleared(system: str, instance: Instance) -> None:
    dead, alive = Subscriber(system, "PSM1"), Subscriber(system, "PSM1")
    dead.want("state", "wrench")
    alive.want("state", "jacobian")
    die(dead)
    assert instance.wanted() == ["state", "state/wrench", "state/jacobian"]
    assert (instance.clearing.clear(), instance.clearing.clear()) == (1, 0)
    assert instance.wanted() == ["state", "state/jacobian"]
    alive.close()
    assert instance.clearing.clear() == 0


def test_a_successor_in_the_place_of_the_dead_does_not_want_what_that_wanted(system: str, instance: Instance) -> None:
    dead = Subscriber(system, "PSM1")
    dead.want("state", "wrench")
    die(dead)
    heir = Subscriber(system, "PSM1")
    assert heir.place == dead.place and instance.wanted() == []
    heir.want("events")
    assert instance.wanted() == ["events"] and instance.clearing.clear() == 0
    heir.close()


def test_when_all_places_are_taken_it_says_by_whom(system: str) -> None:
    held = [Subscriber(system, "PSM1", "größer") for _ in range(SUBSCRIBERS)]
    whose = rf"PSM1: all 64 places for subscriptions are taken: größer \(pid {os.getpid()}, 64 places\); close one"
    with pytest.raises(AllTaken, match=whose):
        Subscriber(system, "PSM1")
    held.pop().close()
    held.append(Subscriber(system, "PSM1"))
    for subscriber in held:
        subscriber.close()


def test_a_forked_child_leaves_the_subscriptions_of_its_parent_alone(system: str, instance: Instance) -> None:
    subscriber = Subscriber(system, "PSM1")
    subscriber.want("state", "wrench")
    child = os.fork()
    if not child:
        subscriber.close()
        os._exit(0)
    os.waitpid(child, 0)
    assert instance.clearing.clear() == 0 and instance.wanted() == ["state", "state/wrench"]
    subscriber.close()


def test_a_client_that_is_killed_wants_nothing_any_more(world: World, system: str, instance: Instance) -> None:
    client = world.start("import sys\nfrom trocar.shm.system.subscriptions import Subscriber\n"
                         "subscriber = Subscriber(sys.argv[1], 'PSM1', 'victim')\nsubscriber.want('state', 'wrench')\n"
                         "print('ready', flush=True)\nsys.stdin.read()")
    assert client.stdout is not None and client.stdout.readline() == "ready\n"
    assert instance.clearing.clear() == 0 and instance.wanted() == ["state", "state/wrench"]
    world.kill(client)
    assert instance.clearing.clear() == 1 and instance.wanted() == []


def test_scribbled_cells_and_a_scribbled_list_stop_nobody(system: str, instance: Instance) -> None:
    page = ControlPage(system, "PSM1", write=True)
    page.field("wanted")[...] = 2**64 - 1
    page.field("holder")[...] = 0xFF
    assert instance.wanted() == WANTED and instance.subscriptions.wanted == 2**64 - 1
    subscriber = Subscriber(system, "PSM1")
    assert instance.clearing.clear() == SUBSCRIBERS - 1 and instance.wanted() == []
    page.segment.header.info["wanted"] = 7
    assert Cells(page).names == ()
    subscriber.close()
    page.close()


NUMBERS = itertools.count()
THINGS = [("state", ()), ("state", ("wrench",)), ("state", ("jacobian", "wrench")), ("events", ())]


class Subscribed(RuleBasedStateMachine):
    """Clients come, want, drop, go, and die at every step of it; the supervisor clears now and then."""

    def __init__(self) -> None:
        super().__init__()
        self.system = f"t{os.getpid()}subs{next(NUMBERS)}"
        create_control(self.system, "PSM1", topics=(STATE, EVENTS))
        self.instance = Instance(self.system)
        self.alive: list[tuple[Subscriber, set[str]]] = []
        self.deaths = 0

    def teardown(self) -> None:
        for subscriber, _ in self.alive:
            subscriber.close()
        self.instance.close()
        remove_all(self.system)

    @precondition(lambda self: len(self.alive) < 5)
    @rule()
    def come(self) -> None:
        self.alive.append((Subscriber(self.system, "PSM1", "somebody"), set()))

    @precondition(lambda self: len(self.alive) < 5)
    @rule()
    def die_before_the_first_step(self) -> None:
        """C1 is done, nothing else: the cell is as its predecessor left it."""
        page = ControlPage(self.system, "PSM1", write=True)
        Cells(page).places.claim(lambda place: True)
        page.close()

    @precondition(lambda self: self.alive)
    @rule(thing=st.sampled_from(THINGS), data=st.data())
    def want(self, thing: tuple[str, tuple[str, ...]], data: st.DataObject) -> None:
        subscriber, wanted = data.draw(st.sampled_from(self.alive))
        topic, groups = thing
        subscriber.want(topic, *groups)
        wanted |= {topic, *(f"{topic}/{group}" for group in groups)}

    @precondition(lambda self: self.alive)
    @rule(thing=st.sampled_from(THINGS), data=st.data())
    def drop(self, thing: tuple[str, tuple[str, ...]], data: st.DataObject) -> None:
        subscriber, wanted = data.draw(st.sampled_from(self.alive))
        topic, groups = thing
        subscriber.drop(topic, *groups)
        wanted -= {f"{topic}/{group}" for group in groups} or {name for name in WANTED if name.startswith(topic)}

    @precondition(lambda self: self.alive)
    @rule(how=st.sampled_from(["go", "die", "die while going"]), data=st.data())
    def end(self, how: str, data: st.DataObject) -> None:
        subscriber, _ = who = data.draw(st.sampled_from(self.alive))
        self.alive.remove(who)
        if how == "go":
            subscriber.close()
        else:
            if how == "die while going":
                subscriber._set(0)
            die(subscriber)

    @rule()
    def clear(self) -> None:
        self.instance.clearing.clear()
        assert set(self.instance.wanted()) == self.expected

    @property
    def expected(self) -> set[str]:
        return set().union(*(wanted for _, wanted in self.alive))

    @invariant()
    def what_the_living_want_is_wanted(self) -> None:
        assert set(self.instance.wanted()) >= self.expected

    @invariant()
    def who_lives_has_a_place_and_a_cell_of_its_own(self) -> None:
        cells = CELLS.unpack(self.instance.pages[0].field("wanted").tobytes())
        places = [subscriber.place for subscriber, _ in self.alive]
        assert len(set(places)) == len(places)
        assert [{name for bit, name in enumerate(WANTED) if cells[s.place] >> bit & 1} for s, _ in self.alive] == [
            wanted for _, wanted in self.alive]


TestSubscribed = Subscribed.TestCase
TestSubscribed.settings = examples(60, stateful_step_count=30)
