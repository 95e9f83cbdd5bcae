"""Teleoperations that share arms hand them over: camera pedal, another selection, a process that is started again.

What one says last may come late, when its successor has begun already: the successor follows every time.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from random import Random

import numpy as np
import pytest

from tests.whole.test_console import Room, homed
from trocar.procs.host.host import Host
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.origins import program_name

pytestmark = pytest.mark.slow

LATE_S = 0.025  # a process that is later begins anew
PATIENCE_S = 4.0
CAMERA, RIGHT, LEFT, THIRD = "MTML_MTMR_ECM", "MTMR_PSM1", "MTML_PSM2", "MTML_PSM3"


class Handovers:
    """A robot in teleoperation, and what its operator does."""

    def __init__(self, room: Room, seed: int) -> None:
        self.host, self.room, self.chance = room.host, room, Random(seed)
        self.camera, self.left = False, LEFT
        room.says("console", "select_teleop", text=LEFT)
        for command, value in (("emulate_camera", 0.0), ("teleop_enable", 1.0), ("emulate_operator_present", 0.0),
                               ("emulate_operator_present", 1.0)):
            room.says("console", command, value)
        assert room.settles(RIGHT, LEFT)

    @property
    def wanted(self) -> set[str]:
        return {CAMERA} if self.camera else {RIGHT, self.left}

    def press_the_camera_pedal(self) -> None:
        self.camera = not self.camera
        self.room.people["console"].send("emulate_camera", (float(self.camera),))

    def select_another(self) -> None:
        self.left = THIRD if self.left == LEFT else LEFT
        self.room.people["console"].send("select_teleop", (), self.left)

    def start_one_again(self) -> None:
        self.host.restart(self.chance.choice((CAMERA, RIGHT, LEFT, THIRD)))
        self.room.people["console"].send("teleop_enable", (1.0,))

    def follows_again(self) -> bool:
        self.host.delay(self.chance.choice((CAMERA, RIGHT, LEFT, THIRD)), self.chance.uniform(0.0, LATE_S))
        self.host.run(LATE_S + 0.015)
        end_ns = self.host.now_ns + round(PATIENCE_S * 1e9)
        while self.room.following != self.wanted and self.host.now_ns < end_ns:
            self.host.run(0.01)
        return self.room.following == self.wanted


@pytest.fixture(scope="module")
def room() -> Iterator[Room]:
    with homed() as made:
        yield made


@pytest.mark.parametrize(("seed", "times"), [(1, 20), pytest.param(2, 1000, marks=pytest.mark.soak)])
def test_after_every_handover_the_successor_follows(room: Room, seed: int, times: int) -> None:
    handovers = Handovers(room, seed)
    for number in range(times):
        what = handovers.chance.choice((handovers.press_the_camera_pedal, handovers.select_another,
                                        handovers.start_one_again))
        what()
        assert handovers.follows_again(), (
            f"handover {number}, {what.__name__}: {handovers.room.following} follow, not {handovers.wanted}; "
            f"{[ring.field('reason').item() for ring in handovers.room.teleops.values()]}")


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
def test_a_hold_from_another_program_ends_teleoperation_until_a_person_does_something(room: Room, which: str) -> None:
    is_ended_by_a_hold(Handovers(room, 3).host, room, which)


def is_ended_by_a_hold(host: Host, room: Room, which: str) -> None:
    slave, teleop = room.arms["PSM1"], room.teleops[RIGHT]
    with contextlib.closing(Client(host.name, which)) as other, contextlib.closing(Client(host.name, "MTMR")) as hand:
        other.send("hold")
        host.run(0.05)
        assert slave.newest() and room.following == {LEFT}
        assert teleop.field("reason").item().decode() == f"{program_name()} (hold) stopped {which}"
        before = slave.field("setpoint_cp").copy()
        assert room.arms["MTMR"].newest()
        hand.send("move_cp", room.arms["MTMR"].field("measured_cp") + (0.02, 0, 0, 0, 0, 0, 0))
        host.run(0.5)
        assert slave.newest() and np.abs(slave.field("setpoint_cp") - before).max() < 1e-9
    for killed in (False, True):
        host.restart(RIGHT, killed=killed)
        host.run(0.3)
        assert teleop.newest() and teleop.field("desired_state").item() == b"DISABLED", "it was stopped before"
    room.says("console", "emulate_operator_present", 0.0)
    room.says("console", "emulate_operator_present", 1.0)
    assert room.settles(RIGHT, LEFT)
