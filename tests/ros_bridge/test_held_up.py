"""What came while the bridge was held up is left out, wherever it stood at that moment."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from trocar.procs.ros_bridge import loop
from trocar.procs.ros_bridge.carrying_out import PendingCommand
from trocar.procs.ros_bridge.loop import DEAF_NS, STREAM_NS, RosLoop

MS_NS = 1_000_000
LATE_S = 1.0
GOAL, MOVE = "goal of a stream", "move"


class StoppedBridge:
    """The loop's waiting, with a clock of the test; `pauses` say how long the kernel holds it up, and where."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns, self.done, self.left_out, self.told, self.looks = 0, [], [], 0, 0
        self.pauses: dict[str, int] = {}
        self.stalls: dict[int, int] = {}
        self.readings = 0  # of the clock; `stalls` are just before one of them
        monkeypatch.setattr(loop, "boottime_ns", self._read_clock)
        made: Any = RosLoop.__new__(RosLoop)
        quiet = SimpleNamespace(take=lambda now_ns: None, hear=lambda: None)
        made.participant = SimpleNamespace(wait=lambda timeout_ns: self._spend("wait", True))
        made._last_look = SimpleNamespace(look=self._look)
        made._incoming, made.services = SimpleNamespace(take=self._take, hear=lambda: None), quiet
        made._awake_ns, made._deaf_until_ns, made._forgets_all, made.name = 0, 0, False, "ros_bridge"
        made.node = SimpleNamespace(late_s=LATE_S, row=SimpleNamespace(period_s=0.005),
                                   events=SimpleNamespace(report=self._report))
        self._loop = made

    def _read_clock(self) -> int:
        self.readings += 1
        self.now_ns += self.stalls.pop(self.readings, 0)
        return self.now_ns

    def _report(self, *args: object, **more: object) -> None:
        self.told += 1

    def _spend(self, where: str, result: Any) -> Any:
        self.now_ns += MS_NS + self.pauses.pop(where, 0)
        return result

    def _take(self) -> list[PendingCommand]:
        came = [PendingCommand(what == GOAL, partial(self._carry_out, what), partial(self.left_out.append, what))
                for what in (GOAL, MOVE)]
        return self._spend("take", came)

    def _look(self) -> None:
        self.looks += 1

    def _carry_out(self, what: str) -> None:
        self.done.append(what)
        self._spend(what, None)

    def turn(self) -> list[str]:
        """What is carried out of one goal and one move that came."""
        self.done, self.left_out = [], []
        self._loop._rest(5 * MS_NS, False)
        return self.done


@pytest.fixture
def bridge(monkeypatch: pytest.MonkeyPatch) -> StoppedBridge:
    made = StoppedBridge(monkeypatch)
    assert made.turn() == [GOAL, MOVE]
    return made


@pytest.mark.parametrize("where", ["wait", "take"])
@pytest.mark.parametrize(("pause_ns", "kept"), [(STREAM_NS // 2, [GOAL, MOVE]), (2 * STREAM_NS, [MOVE]),
                                                (round(2e9 * LATE_S), [])])
def test_goals_of_a_stream_are_left_out_soon_and_all_else_after_a_silence(
        bridge: StoppedBridge, where: str, pause_ns: int, kept: list[str]) -> None:
    bridge.pauses[where] = pause_ns
    assert bridge.turn() == kept
    assert bridge.told == (not kept)
    assert bridge.turn() == kept, "DDS has not brought all of it yet"
    bridge.now_ns += DEAF_NS // 2
    bridge.turn()
    bridge.now_ns += DEAF_NS // 2
    assert bridge.turn() == [GOAL, MOVE]


def test_until_all_is_brought_what_comes_counts_as_sent_before_the_silence(bridge: StoppedBridge) -> None:
    bridge.pauses["wait"] = 5 * STREAM_NS
    before = bridge.looks
    assert bridge.turn() == [MOVE] and bridge.left_out == [GOAL] and bridge.looks == before + 1
    assert bridge.turn() == [MOVE] and bridge.looks == before + 1
    bridge.now_ns += 2 * DEAF_NS
    bridge.turn()
    bridge.turn()
    assert bridge.looks > before + 1


def test_what_was_taken_before_a_silence_is_not_carried_out_after_it(bridge: StoppedBridge) -> None:
    bridge.pauses[GOAL] = round(2e9 * LATE_S)
    assert bridge.turn() == [GOAL]
    assert bridge.told == 1


@pytest.mark.parametrize("reading", range(1, 6))
def test_a_stall_before_any_reading_of_the_clock_is_seen(bridge: StoppedBridge, reading: int) -> None:
    bridge.stalls[bridge.readings + reading] = round(2e9 * LATE_S)
    bridge.turn()
    assert not bridge.stalls
    bridge.turn()
    assert bridge.told == 1
