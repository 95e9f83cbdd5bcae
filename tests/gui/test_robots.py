"""The pages of robots: what they are sent of an io's records, and who may power a robot."""

from __future__ import annotations

import asyncio
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.document.system import Actuator, Brake, IoConfig, Linear, Robot, from_json
from trocar.procs.gui.catalogue import sources_of
from trocar.procs.gui.pid_file import WAITING, PidFiles
from trocar.procs.gui.plot_source import SIGNALS, TraceSource
from trocar.procs.gui.robots import IoRobot, robots_of, slides
from trocar.procs.tables.codes import FAULTS
from trocar.shm.commands import COMMANDS
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.topics import IO_STATE

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
        sources.change((), ["IO1/robot0"])
        sources.begin(monotonic_ns())
        shown = json.loads(b"{" + sources.part("IO1/robot0") + b"}")["IO1/robot0"]
        assert shown["position"] == pytest.approx([0.1 * i for i in range(7)])
        assert (shown["powered"], shown["cause"], shown["remedy"]) == (
            True, fault.cause, fault.remedy_for("PSM1"))
        assert shown["age"] < 1.0
        scripted.io.field("sample_age_ns")[0] = 3_210_000_000  # its board is away, io goes on
        scripted.io.publish(monotonic_ns())
        sources.begin(monotonic_ns())
        assert json.loads(b"{" + sources.part("IO1/robot0") + b"}")["IO1/robot0"]["age"] == 3.2
        sources.close()


def free(kind: str, values: list[float]) -> set[str]:
    """Commands of a kind that need no control, with these values."""
    return {row.name for row in COMMANDS[kind] if row.is_stop("", values)}


def test_without_control_a_robot_can_be_switched_off_and_not_on() -> None:
    assert free("io", [1.0]) == {"power_off", "servo_zero"} < free("io", [0.0])


def test_what_moves_while_a_button_is_held_can_be_stopped_when_control_is_lost() -> None:
    assert free("focus", [0.0]) == {"focus_in", "focus_out"} and free("focus", [1.0]) == set()
    assert free("suj", [0.0]) == {"set_lift_velocity", "clutch"} and free("suj", [-1.0]) == set()


@pytest.mark.slow
def test_a_page_is_sent_the_gains_of_its_robot_however_old(world: World) -> None:
    with robot(world.name) as scripted:
        sources = sources_of(from_json(directory.document(scripted.name)))
        gains = directory.writer(scripted.name, "IO1", "gains", "io")
        gains.field("p_gain")[:] = range(7)
        gains.publish(monotonic_ns() - 60_000_000_000)
        sources.change((), ["IO1/gains0"])
        sources.begin(monotonic_ns())
        shown = json.loads(b"{" + sources.part("IO1/gains0") + b"}")["IO1/gains0"]
        assert shown["p_gain"] == list(range(7)) and shown["age"] == 0.0
        sources.close()
        gains.close()


def test_a_plot_is_sent_each_sample_once(world: World) -> None:
    with robot(world.name) as scripted:
        document = from_json(directory.document(scripted.name))
        trace = TraceSource(scripted.name, robots_of(document)[0], 2)  # io at 1500 Hz: every third
        first = 1_000_000_000_000

        def publish(count: int, start: int) -> None:
            for i in range(start, start + count):
                scripted.io.field("position")[2], scripted.io.field("robot_valid")[0] = i, i != 14
                scripted.io.publish(first + i * 1_000_000)

        assert trace.read(0) == {"age": None}
        publish(12, 0)
        shown = trace.read(0)
        assert shown["t"] == [1000.002, 1000.005, 1000.008, 1000.011]  # numbers of records that 3 divides
        assert shown["v"][SIGNALS.index("position")].tolist() == [2, 5, 8, 11]
        assert trace.read(2_500_000_000) == {"age": 2.5, "t": [], "v": []}
        publish(3, 12)
        assert np.isnan(trace.read(0)["v"][0]).tolist() == [True]  # its boards were away
        trace.close()


@pytest.mark.parametrize(("code", "writes", "status"), [(0, True, 200), (1, False, 409), (0, False, 409)])
def test_a_pid_file_is_that_of_the_command_line_or_its_reason(code: int, writes: bool, status: int,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    async def run(self: PidFiles, *words: str) -> tuple[int, str]:
        asked.extend(words)
        if writes:
            Path(words[3]).write_text("{}")
        return code, f"{words[3]}: said"

    monkeypatch.setattr(PidFiles, "_run", run)
    answer = asyncio.run(PidFiles("robot").file(two_robots()[0]))
    assert asked[:3] == ["pid", "save", "A"] and asked[4:] == ["--system", "robot"]
    assert answer.status_code == status and answer.body == (b"{}" if writes else f"{asked[3]}: said".encode())
    if writes:
        assert answer.headers["content-disposition"] == 'attachment; filename="PID-A.json"'
        assert answer.headers["x-notes"] == "PID-A.json: said" and not Path(asked[3]).exists()


def test_few_wait_for_a_pid_file_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story() -> None:
        go, runs = asyncio.Event(), 0

        async def run(self: PidFiles, *words: str) -> tuple[int, str]:
            nonlocal runs
            runs += 1
            await go.wait()
            return 1, "said"

        monkeypatch.setattr(PidFiles, "_run", run)
        files = PidFiles("robot")
        asked = [asyncio.ensure_future(files.file(two_robots()[0])) for _ in range(WAITING + 2)]
        while not all(each.done() for each in asked[WAITING:]):
            await asyncio.sleep(0)
        assert [each.result().status_code for each in asked[WAITING:]] == [503, 503] and runs == 1
        go.set()
        assert {(await each).status_code for each in asked[:WAITING]} == {409} and runs == WAITING
        assert (await files.file(two_robots()[0])).status_code == 409

    asyncio.run(story())
