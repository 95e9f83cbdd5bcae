"""Instruments' memory read by io: there, absent, taken out meanwhile, unreadable; over links that lose packets."""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.examples import examples
from tests.io.boards_harness import rig_of
from tests.io.harness import FakeCommand, document
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.devices.dallas import Dallas, instrument_memory
from trocar.procs.document.system import InstrumentReader
from trocar.procs.fpga import instrument, registers
from trocar.procs.fpga.instrument import CHUNK_BYTES, RECORD_AT, Instrument, instrument_of
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.instruments import MAX_NS, InstrumentReaders
from trocar.procs.io.reports import IoReports
from trocar.procs.io.robots import Robots

STEP_NS = 1_000_000
LND = instrument_memory("Large Needle Driver", 400006, 3)
TOOL = "LARGE_NEEDLE_DRIVER:400006[3]"


class InstrumentBench:
    """A reader and its board's interface; `loss` is the share of packets lost on the way.

    `asked` counts packets, `waited` those whose answer is waited for.
    """

    def __init__(self, firmware: int = 8, loss: float = 0.0, *, readers: int = 1) -> None:
        self.chips = {6 + k: Dallas(firmware) for k in range(readers)}
        self.loss, self.dice = loss, random.Random(20261121)
        self.now_ns = 1_000_000_000
        self.asked = self.waited = self.most_at_once = 0
        rows = tuple(InstrumentReader(f"PSM{1 + k}_dallas", 6 + k) for k in range(readers))
        self.reports = IoReports()
        data: Any = SimpleNamespace(robots=Robots(document(instrument_readers=rows)), port=self, reports=self.reports)
        self.reader = InstrumentReaders(data, None)

    @property
    def chip(self) -> Dallas:
        return self.chips[6]

    @property
    def tick(self) -> int:
        return self.now_ns * registers.CLOCK_HZ // 1_000_000_000

    def lost(self) -> bool:
        self.asked += 1
        return self.dice.random() < self.loss

    def write_quadlet(self, board: int, address: int, value: int) -> None:
        assert address == registers.DALLAS
        if not self.lost():
            self.chips[board].write(value, self.tick)

    def peek(self, board: int, address: int, quads: int = 1) -> np.ndarray | None:
        self.waited += 1
        if self.lost():
            return None
        values = [self.chips[board].status(self.tick)] if quads == 1 else self.chips[board].read(0, quads, self.tick)
        assert address == (registers.DALLAS if quads == 1 else registers.DALLAS_MEMORY)
        return np.array(values, np.uint32)

    def run(self, seconds: float, good: bool = True) -> None:
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            before = self.waited
            self.reader.step(good, self.now_ns)
            self.most_at_once = max(self.most_at_once, self.waited - before)

    def read(self, seconds: float = 4.0) -> tuple[str, str]:
        """Ask, wait for the end: outcome and its text."""
        command = FakeCommand("trigger_read", "PSM1_dallas")
        assert self.reader.begin(0, command, self.now_ns) == ""
        self.run(seconds)
        return command.answers[-1]

    def shown(self, reader: int = 0) -> tuple[str, str]:
        record = self.reader.record
        return bytes(record["status"][reader]).decode(), bytes(record["tool"][reader]).decode()


@pytest.mark.parametrize("firmware", [7, 8, 9])
def test_an_instrument_is_read_and_told(firmware: int) -> None:
    bench = InstrumentBench(firmware)
    bench.chip.insert(LND, 0)
    assert bench.shown() == ("", "")
    bench.reports.changed.clear()
    assert bench.read(1.0) == ("done", TOOL)
    assert bench.shown() == ("READ", TOOL) and bench.reports.changed == {"instruments"}
    record = bench.reader.record
    assert (bytes(record["name"][0]), record["model"][0], record["version"][0]) == (b"Large Needle Driver", 400006, 3)
    assert bytes(record["reader"][0]) == b"PSM1_dallas"
    (event,) = bench.reports.events
    assert (event.kind, event.code, event.component, event.text) == ("tool_type", "READ", "PSM1_dallas", TOOL)


def test_at_most_one_question_a_cycle_and_none_at_rest() -> None:
    bench = InstrumentBench()
    bench.run(0.5)
    assert bench.asked == 0
    bench.chip.insert(LND, 0)
    bench.read(1.0)
    assert bench.most_at_once == 1 and bench.asked < 60
    asked = bench.asked
    bench.run(0.5)
    assert bench.asked == asked and not bench.chip.enabled  # the line is given back


@pytest.mark.parametrize("firmware", [7, 8])
def test_no_instrument_is_absent(firmware: int) -> None:
    bench = InstrumentBench(firmware)
    assert bench.read(0.1) == ("failed", "no instrument answers")
    assert bench.shown() == ("ABSENT", "") and bench.reports.events[-1].code == "ABSENT"


def test_an_instrument_put_on_after_an_empty_reading_is_seen() -> None:
    bench = InstrumentBench()
    bench.read(0.1)
    bench.chip.insert(LND, bench.tick)
    assert bench.read(1.0) == ("done", TOOL)
    bench.chip.remove(bench.tick)
    assert bench.read(0.1) == ("failed", "no instrument answers")
    assert bench.shown() == ("ABSENT", "")


@cases("after_s", [0.005, 0.03, 0.2, 0.3, 0.345, 0.38, 0.5, 0.7])
def test_taken_out_while_it_is_read_is_no_instrument(after_s: float) -> None:
    bench = InstrumentBench()
    bench.chip.insert(LND, 0)
    command = FakeCommand("trigger_read", "PSM1_dallas")
    bench.reader.begin(0, command, bench.now_ns)
    bench.run(after_s)
    assert bench.shown() == ("READING", "")
    bench.chip.remove(bench.tick)
    bench.run(4.0)
    assert command.outcome == "failed" and bench.shown()[0] in ("ABSENT", "ERROR") and bench.shown()[1] == ""


@examples(25)
@given(st.binary(min_size=CHUNK_BYTES, max_size=CHUNK_BYTES), st.booleans(), st.binary(max_size=28))
def test_whatever_is_in_the_memory_is_an_instrument_or_an_error(record: bytes, ours: bool, name: bytes) -> None:
    if ours:
        at = instrument.NAME_AT - RECORD_AT
        record = instrument.COMPANY + record[3:at] + name + record[at + len(name):]
    try:
        found = instrument_of(record)
    except ValueError as error:
        assert str(error)
        return
    assert found.name.isprintable() and 0 <= found.model < 1 << 24 and 0 <= found.version < 256
    assert len(found.tool.encode()) <= 48 and " " not in found.tool


def test_the_names_of_tool_files_are_found_in_what_is_told() -> None:
    assert Instrument("Large Needle Driver", 400006, 3).tool == TOOL
    assert Instrument("LARGE_NEEDLE_DRIVER", 6, 0).tool == "LARGE_NEEDLE_DRIVER:000006[0]"


@pytest.mark.parametrize(("at", "content", "reported"), [
    (instrument.COMPANY_AT, b"998", "it begins with b'998'"),
    (instrument.NAME_AT, b"\0" * 28, "no readable name"),
    (instrument.NAME_AT, b"\xff" * 28, "no readable name"),
    (instrument.NAME_AT, b"\x80\x81\x82", "no readable name"),
    (instrument.NAME_AT, b"A\nB", "no readable name"),
])
def test_garbage_is_an_error_that_says_why(at: int, content: bytes, reported: str) -> None:
    memory = bytearray(LND)
    memory[at : at + len(content)] = content
    bench = InstrumentBench()
    bench.chip.insert(bytes(memory), 0)
    outcome, text = bench.read(1.0)
    assert outcome == "failed" and reported in text
    assert bench.shown() == ("ERROR", "") and reported in bench.reports.events[-1].text


@pytest.mark.parametrize("loss", [0.05, 0.2])
def test_lost_packets_make_it_slower_and_never_wrong(loss: float) -> None:
    bench = InstrumentBench(loss=loss)
    for _ in range(5):
        bench.chip.insert(LND, bench.tick)
        assert bench.read() == ("done", TOOL)
        bench.chip.remove(bench.tick)
        assert bench.read() == ("failed", "no instrument answers")


def test_a_board_that_never_answers_is_an_error() -> None:
    bench = InstrumentBench(loss=1.0)
    outcome, text = bench.read(MAX_NS * 1e-9 + 0.1)
    assert outcome == "failed" and "in 3 s" in text and bench.shown() == ("ERROR", "")


def test_a_bus_without_good_samples_is_asked_nothing() -> None:
    bench = InstrumentBench()
    bench.chip.insert(LND, 0)
    command = FakeCommand("trigger_read", "PSM1_dallas")
    bench.reader.begin(0, command, bench.now_ns)
    bench.run(1.0, good=False)
    assert bench.asked == 0 and command.outcome == "accepted"
    bench.run(1.0)
    assert command.outcome == "done"


def test_bytes_that_differ_from_reading_to_reading_are_never_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = InstrumentBench()
    bench.chip.insert(LND, 0)
    honest = bench.chip.read

    def shaky(index: int, count: int, tick: int) -> list[int]:
        quads = honest(index, count, tick)
        quads[bench.dice.randrange(count)] ^= 1 << bench.dice.randrange(32)
        return quads

    monkeypatch.setattr(bench.chip, "read", shaky)
    outcome, text = bench.read()
    assert outcome == "failed" and "no two readings agree" in text


def test_a_port_that_cannot_send_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = InstrumentBench()
    bench.chip.insert(LND, 0)
    send, fails = bench.write_quadlet, [True, True]

    def failing(board: int, address: int, value: int) -> None:
        if fails:
            fails.pop()
            raise PortError("no route", "port udp", "check the network")
        send(board, address, value)

    monkeypatch.setattr(bench, "write_quadlet", failing)
    assert bench.read(1.5) == ("done", TOOL)


def test_askers_share_a_reading_and_readers_take_turns() -> None:
    bench = InstrumentBench(readers=2)
    bench.chips[6].insert(LND, 0)
    bench.chips[7].insert(instrument_memory("Hook", 420183, 12), 0)
    first, second, third = (FakeCommand("trigger_read", "") for _ in range(3))
    bench.reader.begin(0, first, bench.now_ns)
    bench.reader.begin(0, second, bench.now_ns)
    bench.reader.begin(1, third, bench.now_ns)
    bench.run(1.2)
    assert first.answers == second.answers == [("accepted", ""), ("done", TOOL)]
    assert third.answers[-1] == ("done", "HOOK:420183[12]") and bench.shown(1) == ("READ", "HOOK:420183[12]")
    assert bench.most_at_once == 1
    for _ in range(16):
        assert bench.reader.begin(0, FakeCommand("trigger_read", ""), bench.now_ns) == ""
    assert "already pending" in bench.reader.begin(0, FakeCommand("trigger_read", ""), bench.now_ns)


@pytest.mark.slow
def test_a_real_site_reads_its_instrument_while_it_holds() -> None:
    harness = rig_of("jhu-dVRK/system-MTML-PSM1-Teleop")
    bus, local = BoardFaults(harness.world, harness.plant).board(harness.world.wiring.rows["IO1", 7])
    chip = bus.boards[local].dallas
    chip.insert(LND, bus.now)
    harness.bring_up("PSM1")
    done = harness.do("trigger_read", "PSM1_dallas")
    assert done.answers[-1] == ("done", TOOL)
    assert harness.record.pid_enabled[harness.robots.names.index("PSM1")] and harness.errors() == []
    assert harness.record.bad_reads == 0
    chip.remove(bus.now)
    assert harness.do("trigger_read", "PSM1_dallas").answers[-1] == ("failed", "no instrument answers")
    refused = harness.do("trigger_read", "PSM2_dallas")
    assert refused.answers == [("refused", "no instrument reader 'PSM2_dallas' here; there are: PSM1_dallas")]
