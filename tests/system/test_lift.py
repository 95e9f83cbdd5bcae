"""A motorised column whose process is stalled, or killed, while it lifts: the emulated lift stops by itself."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.system.robot import Robot, wait_for
from trocar.shm.mailbox.client import Client
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause

pytestmark = pytest.mark.slow
STALL_S = 0.04  # more than the limit of 30 ms and a period, wherever in its period the process is struck
PATIENT = ("--set", "supervisor_lost_s=60", "--set", "processes.SUJ.hung_s=60", "--set", "processes.IO1.hung_s=60")
FASTER = ("--set", "io.period_s=0.001", "--set", "arm.period_s=0.001", "--set", "emulation.period_s=0.001")


class Column:
    """The lift of a site's cart, as io's boards and its potentiometers show it."""

    def __init__(self, robot: Robot) -> None:
        self._io, self._cart = (directory.reader(robot.name, name, "state", kind)
                                for name, kind in (("IO1", "io"), ("SUJ", "suj")))
        names = self._io.info["outputs"]
        assert isinstance(names, list)
        self._pin = names.index("disable_PWM")

    def is_enabled(self) -> bool:
        """Its amplifier."""
        return self._io.newest() and not self._io.field("output")[self._pin]

    def height(self) -> float:
        """By the first potentiometer of its arm, which a round of the multiplexer shows."""
        assert self._cart.newest()
        return float(self._cart.field("primary_voltage")[3, 0])

    def rounds(self) -> int:
        assert self._cart.newest()
        return int(self._cart.field("rounds"))

    def height_after(self, rounds: int) -> float:
        """Of a round that is over; of a process that has just begun, its first one began after that."""
        wait_for(lambda: self.rounds() >= rounds, 30, f"round {rounds} of the multiplexer")
        return self.height()

    def close(self) -> None:
        self._io.close()
        self._cart.close()


class Lifting:
    """A homed cart that an operator lifts, and what strikes its process."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.column, self.client = robot, Column(robot), Client(robot.name, "SUJ")
        self._cart = directory.reader(robot.name, "SUJ", "state", "suj")
        self._events = directory.reader(robot.name, "SUJ", "events", "suj")

    def begins(self, velocity: float) -> None:
        """To lift, for a second; again if the machine stalled a process meanwhile, which ends the command."""

        def attempt() -> str:
            if self.state() != b"ENABLED":
                self.robot.home("SUJ")
            self.client.send("set_lift_velocity", (velocity,))
            end = time.monotonic() + 5
            while not self.column.is_enabled():
                if time.monotonic() > end:
                    return f"the lift stays disabled; SUJ: {[str(row['text']) for row in self._events.last(20)]}"
                pause(0.002)
            return ""

        problem = self.robot.retry(attempt, "the lift")
        assert not problem, problem

    def strike(self, strikes: signal.Signals) -> None:
        """Its process dies, or stalls; wait until it has started again."""
        assert self._cart.newest()
        epoch, pid = self._cart.epoch, self.robot.pid("SUJ")
        os.kill(pid, strikes)
        if strikes is signal.SIGSTOP:
            try:
                pause(STALL_S)
            finally:
                os.kill(pid, signal.SIGCONT)
        wait_for(lambda: self._cart.newest() and self._cart.epoch > epoch, 60, "setup joints that have started again")
        begun_ns = monotonic_ns()
        wait_for(lambda: self._cart.newest() and self._cart.stamp_ns > begun_ns, 60, "their record")
        assert (self.robot.pid("SUJ") == pid) == (strikes is signal.SIGSTOP)

    def state(self) -> bytes:
        assert self._cart.newest()
        return bytes(self._cart.field("state").item())

    def refusals(self) -> list[str]:
        """By io."""
        return [str(row["text"]) for row in self._events.last(100) if row["code"] == b"io-refused"]

    def close(self) -> None:
        for part in (self.column, self.client, self._cart, self._events):
            part.close()


NOISE_V = 2e-3


@pytest.fixture
def lifting(robot: Robot, data: Callable[[str], Path]) -> Iterator[Lifting]:
    """The cart of a site, homed."""
    robot.up(data("dvrk-site/jhu-daVinci/system-SUJ.json"), "--path", str(data("dvrk-share")), "--boards", "emulated",
             *PATIENT, *FASTER)
    robot.home("SUJ")
    made = Lifting(robot)
    yield made
    made.close()


def test_a_column_that_lifts_when_its_process_is_struck_stops_until_an_operator_asks(lifting: Lifting) -> None:
    column = lifting.column
    height = column.height()
    for strikes in (signal.SIGSTOP, signal.SIGKILL):
        lifting.begins(1.0)
        pause(0.3)
        lifting.strike(strikes)
        wait_for(lambda: not column.is_enabled(), 2, "the amplifier of the lift disabled")
        wait_for(lambda: lifting.state() == b"ENABLED", 30, "enabled again")
        stood = column.height_after(1)
        assert stood != pytest.approx(height, abs=NOISE_V)
        assert column.height_after(2) == pytest.approx(stood, abs=NOISE_V) and not column.is_enabled()
        lifting.begins(-1.0)
        wait_for(lambda: not column.is_enabled(), 10, "its end after a second")
        height = column.height_after(column.rounds() + 2)
        assert height != pytest.approx(stood, abs=NOISE_V)
        assert lifting.refusals() == []
