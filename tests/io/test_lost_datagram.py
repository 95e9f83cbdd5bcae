"""Any single datagram is lost, one after the other: each order to the boards is carried out all the same."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.io.boards_harness import BoardsHarness, Direct
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.fpga import registers

pytestmark = pytest.mark.slow

DATAGRAMS = 12
"""Requests and replies from an order on of which each is lost in turn: those of three cycles."""
ON = registers.STATUS_POWER | registers.STATUS_MV_GOOD | registers.STATUS_RELAY | registers.STATUS_RELAY_FEEDBACK


@cache
def demo() -> SystemConfig:
    """The demo's PSM."""
    system = load_system(PROJECT_CONFIGS / "systems" / "demo.yaml").system
    assert system is not None
    return system


class LosesOne(Direct):
    """A transport that loses one datagram, a request or a reply: that with number `lost`, counted in `passed`."""

    lost, passed = -1, 0

    def _lost(self) -> bool:
        self.passed += 1
        return self.passed - 1 == self.lost

    def lose_one(self, number: int) -> None:
        """Of the next datagrams; -1: none."""
        self.lost, self.passed = number, 0


class OneLost(BoardsHarness):
    """It and its io, which may lose a datagram."""

    link: LosesOne

    def __init__(self, lost: int = -1) -> None:
        """`lost`: the datagram of io's start that is lost."""
        self.lost = lost
        super().__init__(demo(), driven=True, link=self._link)
        self.start_datagrams = self.link.passed
        self.faults = BoardFaults(self.world, self.plant)

    def _link(self, *given) -> LosesOne:
        link = LosesOne(*given)
        link.lose_one(self.lost)
        return link

    def words(self, address: int = registers.STATUS) -> np.ndarray:
        """This register of every board, without loss."""
        self.link.lose_one(-1)
        return np.array([self.port.read_quadlet(board, address) for board in self.port.board_ids])

    def until_powered(self) -> None:
        for _ in range(3000):
            self.cycle()
            if self.record.amps_on[0] and self.record.powered[0]:
                return
        raise AssertionError(f"no power: {self.events}")


def test_power_comes_on_and_the_relays_open_again_whatever_single_datagram_is_lost() -> None:
    harness = OneLost()
    for number in range(DATAGRAMS):
        harness.link.lose_one(number)
        harness.do("power_on", "PSM1")
        harness.until_powered()
        assert (harness.words() & ON == ON).all(), f"datagram {number} of power-on"
        harness.link.lose_one(number)
        harness.do("power_off", "PSM1", 1.0)
        harness.cycle(count=10)
        words = harness.words()
        assert not (words & (registers.STATUS_POWER | registers.STATUS_RELAY)).any(), f"datagram {number} of power-off"
        assert harness.errors() == []


def test_a_fault_switches_all_off_whatever_single_datagram_is_lost() -> None:
    harness = OneLost()
    for number in range(DATAGRAMS):
        harness.do("power_on", "PSM1")
        harness.until_powered()
        harness.faults.fail_amplifier("PSM1", 0, True)
        harness.link.lose_one(number)
        harness.cycle(count=150)
        words = harness.words()
        assert not (words & registers.STATUS_POWER).any(), f"datagram {number}"
        assert {code for code, _ in harness.errors()} == {"amplifier"}
        harness.faults.fail_amplifier("PSM1", 0, False)
        harness.do("clear_fault", "PSM1")
        harness.events.clear()


def test_a_board_that_returns_gets_its_watchdog_period_whatever_single_datagram_is_lost() -> None:
    harness = OneLost()
    period = harness.words(registers.WATCHDOG).copy()
    for number in range(DATAGRAMS):
        harness.faults.take_away(harness.port.board_ids[-1], True)
        harness.cycle(count=100)
        assert harness.port.away.any()
        harness.faults.take_away(harness.port.board_ids[-1], False)
        harness.link.lose_one(number)
        harness.cycle(count=200)
        assert not harness.port.away.any() and (harness.words(registers.WATCHDOG) == period).all(), number


def test_io_starts_whatever_single_datagram_is_lost() -> None:
    harness = OneLost()
    harness.cycle(count=10)
    started = harness.words(registers.WATCHDOG).copy()
    assert (harness.words() & registers.STATUS_RELAY).all()
    for number in range(harness.start_datagrams):
        again = OneLost(lost=number)
        again.cycle(count=160)
        assert (again.words(registers.WATCHDOG) == started).all(), number
        assert (again.words() & registers.STATUS_RELAY).all(), number
