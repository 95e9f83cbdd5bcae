"""A board gets no power before it has shown the watchdog period that was written to it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.io.harness import PERIOD_NS, FakePort, IoHarness
from trocar.procs.fpga import registers
from trocar.procs.io.reports import IoReports
from trocar.procs.io.robots import Robots
from trocar.procs.io.watchdogs import RETRY_NS, TRIES, Watchdogs

COUNTS = 5760  # 30 ms


class DeafPort(FakePort):
    """Boards that are `deaf` show a period of their own, whatever is written."""

    deaf: tuple[int, ...] = (1,)

    def peek(self, board: int, address: int, quads: int = 1) -> np.ndarray:
        shown = super().peek(board, address, quads)
        return shown - 1 if board in self.deaf and address == registers.WATCHDOG else shown


def reported(harness: IoHarness) -> list[str]:
    return [event.code for event in harness.core.reports.events]


def leave_and_return(harness: IoHarness, board: int) -> None:
    row = harness.core.robots.board_ids.index(board)
    harness.port.away[row] = True
    harness.run(2)
    harness.port.away[row] = False
    harness.port.power_cycle(board)
    harness.run(2)


@pytest.mark.parametrize("word", ["power_on", "supply_on"])
def test_a_board_that_returns_and_does_not_confirm_its_watchdog_gets_no_power(word: str) -> None:
    harness = IoHarness(preset=True)
    harness.port.__class__ = DeafPort
    leave_and_return(harness, 1)
    assert reported(harness).count("watchdog-unconfirmed") == 1
    refused = harness.ask(word, *((1.0,) if word == "supply_on" else ()))
    assert refused.outcome == "refused" and "watchdog period not confirmed by board 1" in refused.answers[-1][1]
    assert not harness.record.power_requested[0]
    harness.port.deaf = ()
    harness.run(RETRY_NS // PERIOD_NS + 2)
    assert harness.ask(word, *((1.0,) if word == "supply_on" else ())).outcome in ("accepted", "done")
    assert harness.port.registers[1, registers.WATCHDOG] == COUNTS


def test_one_lost_datagram_is_no_warning() -> None:
    harness = IoHarness(preset=True)
    harness.port.lost_writes = TRIES - 1
    leave_and_return(harness, 1)
    assert harness.port.registers[1, registers.WATCHDOG] == COUNTS and "watchdog-unconfirmed" not in reported(harness)


def data_of(harness: IoHarness, port: DeafPort, reports: IoReports) -> Any:
    return SimpleNamespace(robots=Robots(harness.io), port=port, reports=reports)


def test_boards_that_do_not_confirm_are_reported_once_at_the_start() -> None:
    harness, reports = IoHarness(preset=True), IoReports()
    port = DeafPort((0, 1))
    watchdogs = Watchdogs(data_of(harness, port, reports), 0)
    assert watchdogs.unconfirmed.tolist() == [False, True]
    for cycle in range(1, 1000):
        watchdogs.step(cycle * PERIOD_NS)
    assert [(event.code, event.board) for event in reports.events] == [("watchdog-unconfirmed", 1)]
    assert "board 1" in watchdogs.objection(0)


def test_a_board_that_never_confirms_does_not_keep_others_from_it() -> None:
    harness, reports = IoHarness(preset=True), IoReports()
    port = DeafPort((0, 1))
    port.deaf = (0, 1)
    watchdogs = Watchdogs(data_of(harness, port, reports), 0)
    assert watchdogs.objection(0) == "watchdog period not confirmed by boards 0, 1"
    port.deaf = (0,)
    for cycle in range(1, 3 * RETRY_NS // PERIOD_NS):
        watchdogs.step(cycle * PERIOD_NS)
    assert watchdogs.unconfirmed.tolist() == [True, False]
