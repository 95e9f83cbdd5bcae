"""The child that reads potentiometer boards over Bluetooth: what it says, when it asks again, how it ends."""

from __future__ import annotations

import asyncio
import json
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from trocar.procs.suj import bluetooth


class FakeBoard:
    """A board's client: what each read gives, an error among them."""

    made: list[tuple[str, float]] = []  # noqa: RUF012  # of all of them
    reads: list[Any] = []  # noqa: RUF012

    def __init__(self, address: str, timeout: float) -> None:
        self.made.append((address, timeout))

    async def __aenter__(self) -> FakeBoard:
        return self

    async def __aexit__(self, *error: object) -> None: ...

    async def read_gatt_char(self, characteristic: str) -> bytes:
        assert characteristic == bluetooth.POTS
        what = self.reads.pop(0)
        if isinstance(what, BaseException):
            raise what
        return bytes(what)


@pytest.fixture
def naps(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """How long is slept, in seconds."""
    found: list[float] = []

    async def sleep(seconds: float) -> None:
        found.append(seconds)

    monkeypatch.setattr(asyncio, "sleep", sleep)
    FakeBoard.made = []
    return found


def said(capsys: pytest.CaptureFixture[str]) -> list[dict[str, str]]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_a_board_is_read_ten_times_a_second_and_connected_to_again_after_an_error(
        naps: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    FakeBoard.reads = [b"one", b"\xfftwo", OSError("x" * 200), b"three", BrokenPipeError()]
    with pytest.raises(BrokenPipeError):
        asyncio.run(bluetooth.watch(FakeBoard, "AA"))
    assert said(capsys) == [{"board": "AA", "reading": "one"}, {"board": "AA", "reading": "\ufffdtwo"},
                            {"board": "AA", "problem": f"OSError: {'x' * 141}"}, {"board": "AA", "reading": "three"}]
    assert naps == [0.1, 0.1, 5.0, 0.1] and FakeBoard.made == [("AA", 10.0)] * 2


def test_all_boards_are_watched_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    watched: list[tuple[object, str]] = []

    async def watch(client_of: object, address: str) -> None:
        watched.append((client_of, address))

    monkeypatch.setattr(bluetooth, "watch", watch)
    asyncio.run(bluetooth.watch_all(FakeBoard, ("AA", "BB")))
    assert watched == [(FakeBoard, "AA"), (FakeBoard, "BB")]


def test_without_the_package_each_board_is_told_so(monkeypatch: pytest.MonkeyPatch,
                                                   capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "bleak", None)
    monkeypatch.setattr(sys, "argv", ["x", "AA", "BB"])
    with pytest.raises(SystemExit) as ended:
        bluetooth.main()
    assert ended.value.code == 1
    assert [(row["board"], "pip install" in row["problem"]) for row in said(capsys)] == [("AA", True), ("BB", True)]


def test_the_reader_ends_in_order_when_nobody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    module: Any = ModuleType("bleak")
    module.BleakClient = FakeBoard
    monkeypatch.setitem(sys.modules, "bleak", module)
    monkeypatch.setattr(sys, "argv", ["x", "AA", "BB"])
    asked: list[object] = []

    async def watch_all(client_of: object, addresses: list[str]) -> None:
        asked.append((client_of, addresses))
        raise BrokenPipeError

    monkeypatch.setattr(bluetooth, "watch_all", watch_all)
    with pytest.raises(SystemExit) as ended:
        bluetooth.main()
    assert ended.value.code == 0 and asked == [(FakeBoard, ["AA", "BB"])]


class FakeChild:
    """A child whose pipe a test fills."""

    def __init__(self) -> None:
        self.did: list[str] = []
        self.stdout = SimpleNamespace(fileno=lambda: 77, close=lambda: self.did.append("close"))

    def terminate(self) -> None:
        self.did.append("terminate")

    def wait(self) -> None:
        self.did.append("wait")


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> tuple[list[Any], list[FakeChild]]:
    """What the next reads give, and the children that were started."""
    data: list[Any] = []
    children: list[FakeChild] = []

    def read(descriptor: int, most: int) -> bytes:
        assert descriptor == 77 and most == bluetooth.MOST
        if not data:
            raise BlockingIOError
        return bytes(data.pop(0))

    def start(*command: object, **options: object) -> FakeChild:
        children.append(FakeChild())
        return children[-1]

    monkeypatch.setattr(bluetooth.subprocess, "Popen", start)
    monkeypatch.setattr(bluetooth.os, "set_blocking", lambda descriptor, on: None)
    monkeypatch.setattr(bluetooth.os, "read", read)
    return data, children


def test_lines_are_put_together_and_what_is_none_is_passed_over(pipe: tuple[list[Any], list[FakeChild]]) -> None:
    data, _ = pipe
    boards = bluetooth.BluetoothBoards(("aa", "BB"))
    assert boards.poll(1) == [] and boards.problem("AA") == boards.problem("bb") == "not connected yet"
    assert boards.problem("CC") == "this board is not polled"
    data += [b'{"board": "aa", "rea', b'ding": "1"}\n[]\n{"board": 7}\nx\n{"board": "bb", "problem": "far"}\n{"bo']
    assert boards.poll(2) == [] and boards.poll(3) == [("AA", b"1")] and boards.poll(4) == []
    assert (boards.problem("aa"), boards.problem("BB"), boards.problem("7")) == ("", "far", "")
    data.append(b"x" * bluetooth.MOST)
    boards.poll(5)
    data += [b'"\n{"board": "bb", "reading": "2"}\n']
    assert boards.poll(6) == [("BB", b"2")] and boards.problem("bb") == ""


def test_a_reader_that_has_ended_is_started_again_after_30_s(pipe: tuple[list[Any], list[FakeChild]]) -> None:
    data, children = pipe
    boards = bluetooth.BluetoothBoards(("aa", "bb"))
    data += [b'{"board": "aa", "reading": "1"}\n{"board": "bb"', b""]
    boards.poll(5)
    boards.poll(10)
    assert boards.problem("aa") == "the Bluetooth reader has ended" and boards.problem("bb") == "not connected yet"
    boards.poll(10 + bluetooth.AGAIN_NS)
    assert len(children) == 1 and not children[0].did
    data.append(b'{"board": "bb", "reading": "2"}\n')
    assert boards.poll(11 + bluetooth.AGAIN_NS) == [("BB", b"2")], "half a line of before is forgotten"
    assert len(children) == 2 and children[0].did == ["terminate", "close", "wait"] and not children[1].did
