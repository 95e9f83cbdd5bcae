"""What is computed on demand: programs want it from their first look at it until they are closed, or end."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

import trocar
from tests.conftest import World
from tests.tools.robot import ScriptedRobot, nothing_ages, robot
from tests.tools.test_verbs import lines, run
from trocar.procs.crtk import demand
from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.topics import find
from trocar.procs.crtk.views import OpenTopic
from trocar.procs.ros_bridge.publishing import RecordTopics
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber, Subscriptions
from trocar.shm.time.clock import monotonic_ns

if TYPE_CHECKING:
    from trocar.procs.ros_messages.dds import Participant

FORCE = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


class Playing:
    """The arm: whenever the program waits it looks what is wanted, and shows that."""

    def __init__(self, scripted: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
        self.subscriptions, self.scripted = Subscriptions(scripted.pages["PSM1"]), scripted
        self.bit = self.subscriptions.bits("state", "wrench")
        monkeypatch.setattr(demand, "pause", self.pause)

    def pause(self, seconds: float) -> None:
        """A cycle."""
        self.scripted.arm.field("body_measured_cf")[...] = FORCE if self.is_wanted else np.nan
        self.scripted.arm.publish(monotonic_ns())

    @property
    def is_wanted(self) -> bool:
        self.subscriptions.look()
        return bool(self.subscriptions.wanted & self.bit)


@pytest.fixture
def arm(world: World, monkeypatch: pytest.MonkeyPatch) -> Iterator[Playing]:
    nothing_ages(monkeypatch)
    with robot(world.name) as made:
        made.show_arm()
        yield Playing(made, monkeypatch)


def test_echo_wants_what_it_shows_and_nothing_afterwards(arm: Playing) -> None:
    name = arm.scripted.name
    (row,) = lines(run("echo", "PSM1/body/measured_cf", "--once", "--json", "--system", name))
    assert (row["force"], row["torque"]) == ([1, 2, 3], [4, 5, 6])
    assert not arm.is_wanted


def test_what_one_reader_in_ros_leaves_another_still_gets(arm: Playing) -> None:
    name, writers = arm.scripted.name, {view: SimpleNamespace(is_read=True) for view in ("body", "spatial")}
    reader, wanted = directory.reader(name, "PSM1", "state"), Wanted(name, "test")
    views = [(find(name, f"PSM1/{view}/measured_cf"), view) for view in writers]
    participant = cast("Participant", SimpleNamespace(writer=lambda topic, *_: writers[topic]))
    topics = RecordTopics(participant, wanted, "PSM1", reader, views, ())
    for left, still in (("", True), ("body", True), ("spatial", False)):
        if left:
            writers[left].is_read = False
        topics.look()
        assert arm.is_wanted is still, left
    wanted.close()
    reader.close()


@pytest.mark.slow
def test_echo_shows_null_where_nobody_computes_it(arm: Playing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arm, "bit", 0)
    (row,) = lines(run("echo", "PSM1/body/measured_cf", "--once", "--json", "--system", arm.scripted.name))
    assert (row["valid"], row["force"]) == (True, [None] * 3)


def test_echo_of_other_things_wants_the_topic_alone(arm: Playing) -> None:
    name = arm.scripted.name
    with OpenTopic(name, find(name, "PSM1/measured_js")) as source, Wanted(name) as desired:
        desired.want(source.entry)
        arm.subscriptions.look()
        assert arm.subscriptions.wanted == arm.subscriptions.bits("state")


def test_looking_wants_nothing(arm: Playing) -> None:
    for words in (["list"], ["status"]):
        run(*words, "--system", arm.scripted.name)
        assert not arm.subscriptions.look()


def test_a_program_wants_wrenches_from_its_first_look_until_it_is_closed(arm: Playing) -> None:
    with trocar.arm("PSM1", system=arm.scripted.name) as psm:
        psm.measured_cp()
        assert not arm.is_wanted
        assert psm.body.measured_cf()[0].tolist() == list(FORCE) and arm.is_wanted
    assert not arm.is_wanted


def test_a_program_is_told_what_was_not_computed(arm: Playing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arm, "bit", 0)
    monkeypatch.setattr("trocar.tools.client.shared.FRESH_S", 0.05)
    with (trocar.arm("PSM1", system=arm.scripted.name) as psm,
          pytest.raises(TimeoutError, match=r"PSM1/body/measured_cf was not computed within 0\.05 s")):
        psm.body.measured_cf()


def test_echo_says_when_there_is_no_place_for_it(arm: Playing, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise SegmentError("all places are taken")

    monkeypatch.setattr(Subscriber, "__init__", full)
    result = run("echo", "PSM1/measured_js", "--once", "--json", "--system", arm.scripted.name)
    assert lines(result) and "computed on demand may be missing (all places are taken)" in result.stderr
