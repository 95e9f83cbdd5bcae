"""A motorised column whose process is held up, or killed, while it lifts: the emulated lift stops by itself."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.system.robot import Robot, wait_for
from trocar.shm.mailbox.client import Client
from trocar.shm.system import directory
from trocar.shm.time.clock import pause

pytestmark = pytest.mark.slow
HELD_UP_S = 0.04  # more than the limit of 30 ms and a period, wherever in its period the process is struck
PATIENT = ("--set", "supervisor_lost_s=60", "--set", "processes.SUJ.hung_s=60", "--set", "processes.IO1.hung_s=60")


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

    def next_height(self) -> float:
        """Of a round that begins from now on."""
        begun = self.rounds()
        wait_for(lambda: self.rounds() != begun and self.rounds() > 1, 30, "a round of the multiplexer")
        begun = self.rounds()
        wait_for(lambda: self.rounds() > begun, 30, "another one")
        return self.height()

    def stands(self) -> bool:
        return abs(self.next_height() - self.next_height()) < NOISE_V

    def close(self) -> None:
        self._io.close()
        self._cart.close()


NOISE_V = 2e-3


@pytest.mark.parametrize("strikes", [signal.SIGSTOP, signal.SIGKILL], ids=["held up for 40 ms", "killed"])
def test_a_column_that_lifts_when_its_process_is_struck_stops_until_an_operator_asks(
        robot: Robot, data: Callable[[str], Path], strikes: signal.Signals) -> None:
    robot.up(data("dvrk-site/jhu-daVinci/system-SUJ.json"), "--path", str(data("dvrk-share")), "--boards", "emulated",
             *PATIENT)
    robot.home("SUJ")
    column, client = Column(robot), Client(robot.name, "SUJ")
    cart = directory.reader(robot.name, "SUJ", "state", "suj")
    try:
        before = column.next_height()
        client.send("set_lift_velocity", (1.0,))
        wait_for(column.is_enabled, 10, "the lift")
        pause(0.3)
        assert cart.newest()
        epoch, pid = cart.epoch, robot.pid("SUJ")
        os.kill(pid, strikes)
        if strikes is signal.SIGSTOP:
            try:
                pause(HELD_UP_S)
            finally:
                os.kill(pid, signal.SIGCONT)
        wait_for(lambda: cart.newest() and cart.epoch > epoch, 60, "setup joints that began anew")
        assert (robot.pid("SUJ") == pid) == (strikes is signal.SIGSTOP)
        wait_for(lambda: not column.is_enabled(), 2, "the amplifier of the lift disabled")
        wait_for(lambda: cart.newest() and bytes(cart.field("state").item()) == b"ENABLED", 30, "goes on")
        assert column.stands() and not column.is_enabled() and column.height() != pytest.approx(before, abs=NOISE_V)
        stood = column.height()
        client.send("set_lift_velocity", (-1.0,))
        wait_for(column.is_enabled, 10, "the lift")
        wait_for(lambda: not column.is_enabled(), 10, "its end after a second")
        assert abs(column.next_height() - stood) > NOISE_V and column.stands()
        refused = [row["text"] for row in directory.reader(robot.name, "SUJ", "events", "suj").last(100)
                   if row["code"] == b"io-refused"]
        assert refused == []
    finally:
        for part in (cart, client, column):
            part.close()
    assert np.isfinite(stood)
