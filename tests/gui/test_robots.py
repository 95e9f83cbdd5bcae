"""The pages of robots: what they are sent of an io's records, and who may power a robot."""

from __future__ import annotations

import dataclasses
import json

import pytest

from procs.codes import FAULTS
from procs.document.system import Actuator, Brake, IoConfig, Linear, Robot, from_json
from procs.gui.browsers import FOR_ALL
from procs.gui.catalogue import sources_of
from procs.gui.robots import IoRobot, robots_of, slides
from shm import directory
from shm.clock import monotonic_ns
from shm.commands import COMMANDS
from shm.topics import IO_STATE
from tests.conftest import World
from tests.tools.robot import robot

LINE = Linear(1.0)
MOTOR = Actuator(3, 0, "PRISMATIC", 1.0, LINE, LINE, 1.0)
BRAKE = Brake(3, 0, LINE, LINE, 1.0, 0.5, 0.1, 0.2, 0.0)


def two_robots() -> list[IoRobot]:
    """On one io: two motors and a brake, three motors and two brakes."""
    rows = (Robot("A", "1", "QLA1", (MOTOR,) * 2, brakes=(BRAKE,)),
            Robot("B", "2", "QLA1", (MOTOR,) * 3, brakes=(BRAKE,) * 2))
    io = IoConfig("IO1", "udp", "broadcast-query-read-write", 1e-3, 0.03, False, rows, (), ())
    with_io = dataclasses.make_dataclass("Document", ["ios"])((io,))
    return robots_of(with_io)


def test_a_robot_is_cut_out_of_the_record_of_its_io() -> None:
    first, second = two_robots()
    for made, axes, drives in ((first, [0, 1], [0, 1, 5]), (second, [2, 3, 4], [2, 3, 4, 6, 7])):
        cuts = made.cuts(IO_STATE.fields)
        assert list(range(8))[cuts["position"]] == axes and cuts["current"].tolist() == drives
        assert cuts["powered"] == made.place and "input" not in cuts and "cycle" not in cuts
    assert second.path("io") == "/io/IO1/B" and second.axis_names == ["actuator 0", "actuator 1", "actuator 2"]
    assert slides(second.robot, None) == [True, True, True]


def test_a_page_is_sent_its_robot_and_its_fault_in_words(world: World) -> None:
    with robot(world.name) as scripted:
        sources = sources_of(from_json(directory.document(scripted.name)))
        fault = FAULTS[0]
        scripted.io.field("position")[:7] = [0.1 * i for i in range(7)]
        scripted.io.field("fault")[0] = fault.number
        scripted.io.field("powered")[0] = True
        scripted.io.publish(monotonic_ns())
        sources.take("IO1/robot0")
        sources.begin(monotonic_ns())
        shown = json.loads(b"{" + sources.part("IO1/robot0") + b"}")["IO1/robot0"]
        assert shown["position"] == pytest.approx([0.1 * i for i in range(7)])
        assert (shown["powered"], shown["cause"], shown["remedy"]) == (True, fault.cause, fault.remedy)
        sources.close()


def test_without_control_a_robot_can_be_switched_off_and_not_on() -> None:
    rows = {row.name: row for row in COMMANDS["io"]}
    free = {name for name, row in rows.items() if ("io", name) in FOR_ALL and row.is_stop("PSM1", [])}
    assert free == {"power_off"}
