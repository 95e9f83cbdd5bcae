"""`trocar bus` on emulated controllers at an address of their own."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from tests.fpga import board_side
from tests.io.controllers_bus import ControllersBus, controller
from tests.io.stub_bus import StubBoard, StubBus
from trocar.procs.document.system import Controller
from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus import named_port
from trocar.procs.io.bus.bus_port import USUAL
from trocar.procs.io.bus.named_port import port_of
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools import cli
from trocar.tools.inspect import bus_client, samples
from trocar.tools.inspect.bus_client import FoundBoard
from trocar.tools.output.errors import Problem
from trocar.tools.verbs import bus

APP = cli.build("bus")
QLA, DQLA, DRA = (FoundBoard(2, 0, hardware, 8, 2, 0, True) for hardware in ("QLA1", "DQLA", "dRA1"))
WRITES = (wire.QUADLET_WRITE, wire.BLOCK_WRITE)
PATIENT = """from trocar.procs.io.bus import bus_server, discovery, link
discovery.NODES, discovery.SCAN_TIMEOUTS_MS, link.SETUP_TIMEOUT_MS = {nodes}, (5000,), 5000
bus_server.main()"""


def ask_patiently(monkeypatch: pytest.MonkeyPatch, nodes: int) -> None:
    """Whoever speaks to the boards waits for late replies, and asks only as many nodes as there are."""
    monkeypatch.setattr(bus_client, "SERVER", ("-c", PATIENT.format(nodes=nodes)))


class Recorded(ControllersBus):
    """Keeps the requests that came."""

    def __init__(self, *controllers: Controller) -> None:
        super().__init__(*controllers, port=wire.UDP_PORT)
        self.requests: list[board_side.WireRequest] = []
        answer = self.bus.answer
        self.bus.answer = lambda data, tick: (
            self.requests.append(board_side.decode_request(data)), answer(data, tick))[1]

    @property
    def name(self) -> str:
        return f"udp:{self.address}"

    @property
    def writes(self) -> list[board_side.WireRequest]:
        return [request for request in self.requests if request.tcode in WRITES]

    @property
    def samples(self) -> list[board_side.WireRequest]:
        return [r for r in self.requests if r.tcode == wire.BLOCK_READ and r.address == registers.REAL_TIME]


@pytest.fixture
def desk_bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorded]:
    """Two QLA1."""
    ask_patiently(monkeypatch, 2)
    with Recorded(Controller(0, serial="1234-56"), Controller(3, serial="1234-57")) as made:
        yield made


def run(*words: object, code: int = 0) -> Result:
    result = CliRunner().invoke(APP, ["bus", *map(str, words)])
    assert result.exit_code == code, result.output + result.stderr
    return result


def rows(*words: object) -> list[dict[str, Any]]:
    return [json.loads(line) for line in run(*words, "--json").stdout.splitlines()]


# -- scan --------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_scan_names_every_controller(desk_bus: Recorded) -> None:
    hub, other = rows("scan", desk_bus.name)
    assert (hub["board"], hub["node"], hub["hardware"], hub["firmware"], hub["fpga"]) == (0, 0, "QLA1", 8, 2)
    assert (hub["is_hub"], other["is_hub"], other["board"]) == (True, False, 3)
    assert (hub["fpga_serial"], hub["qla_serial"]) == ("1234-56", "1234-56")
    assert (other["fpga_serial"], other["qla_serial"]) == ("1234-57", "1234-57")
    assert hub["state"].startswith("power off, relay open, watchdog 30 ms")


@pytest.mark.slow
def test_scan_prints_a_table_for_eyes(desk_bus: Recorded) -> None:
    text = run("scan", desk_bus.name).stdout
    words = " ".join(text.split())
    assert "hub" in words and "1234-57" in words


@pytest.mark.slow
def test_scan_beside_a_running_io_writes_nothing(desk_bus: Recorded) -> None:
    run("scan", desk_bus.name)
    del desk_bus.requests[:]
    with named_port.hold(desk_bus.name):
        result = run("scan", desk_bus.name)
    assert f"no serial numbers: port {desk_bus.name}: in use by pid {os.getpid()}" in result.stderr
    assert desk_bus.requests and not desk_bus.writes and not desk_bus.samples


@pytest.mark.slow
def test_silent_bus_is_told_with_its_address() -> None:
    assert "127.99.0.1:1394: no controller answers" in run("scan", "udp:127.99.0.1", code=1).stderr


@pytest.mark.slow
def test_unknown_port_is_misuse() -> None:
    assert "allowed" in run("scan", "udp:300.1.1.1", code=2).stderr


@pytest.mark.slow
def test_port_that_this_machine_has_not_is_told() -> None:
    assert "no such Ethernet interface; of this machine" in run("scan", "eth:nosuch", code=1).stderr


@pytest.mark.slow
def test_boards_that_share_an_id_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    ask_patiently(monkeypatch, 3)
    with StubBus([StubBoard(5, 0), StubBoard(2, 1), StubBoard(2, 2)], port=wire.UDP_PORT) as stub:
        name = f"udp:{stub.address}"
        reported = " ".join(run("scan", name, "--no-serials", code=1).stdout.split())
        assert reported.count("2 boards have id 2 (nodes 1 and 2); set every rotary switch differently") == 2
        assert "2 boards have id 2" in run("read", name, 2, "STATUS", code=1).stderr
        assert "2 boards have id 2" in run("write", name, "all", "STATUS", 0, "--yes", code=1).stderr
        run("read", name, 5, "STATUS")


# -- read --------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_read_prints_value_and_meaning(desk_bus: Recorded) -> None:
    text = run("read", desk_bus.name, 3, "watchdog").stdout
    assert "board 3 (QLA1, firmware Rev 8, FPGA V2) WATCHDOG = 0x00001680  30 ms" in text


@pytest.mark.slow
def test_read_takes_numbers_and_a_count(desk_bus: Recorded) -> None:
    found = rows("read", desk_bus.name, 0, "0x4", 4)
    assert [row["register"] for row in found] == ["HARDWARE_ID", "TEMPERATURE", "DIGITAL_OUTPUT", "FIRMWARE"]
    assert (found[0]["value"], found[0]["meaning"], found[3]["meaning"]) == (registers.QLA1, "QLA1", "Rev 8")


@pytest.mark.slow
def test_bare_axis_register_is_read_of_every_axis(desk_bus: Recorded) -> None:
    found = rows("read", desk_bus.name, 0, "ENCODER")
    assert [row["register"] for row in found] == [f"ENCODER:{axis}" for axis in (1, 2, 3, 4)]
    assert {row["meaning"] for row in found} == {"+0 counts"}


@pytest.mark.slow
def test_reading_refreshes_no_watchdog(desk_bus: Recorded) -> None:
    run("scan", desk_bus.name, "--no-serials")  # gives the hub its address
    del desk_bus.requests[:]
    run("read", desk_bus.name, 0, "STATUS", 16)
    assert desk_bus.requests and not desk_bus.writes and not desk_bus.samples


@pytest.mark.slow
def test_absent_board_is_told_with_those_there_are(desk_bus: Recorded) -> None:
    assert "no board 7 on port" in (text := run("read", desk_bus.name, 7, "STATUS", code=1).stderr)
    assert "boards there: 0, 3" in text


@pytest.mark.parametrize(("words", "reported"), [
    (("0", "WATCHDOK"), "no register WATCHDOK; allowed: a number, or WATCHDOG"),
    (("0", "ENCODER:11"), "allowed: ENCODER:1 to ENCODER:10"),
    (("0", "ENCODER:0"), "allowed: ENCODER:1 to ENCODER:10"),
    (("0", "0x10000"), "allowed 0 to 0xFFFF"),
    (("0", "0xFFFF", "2"), "allowed up to 0xFFFF"),
    (("16", "STATUS"), "board 16: allowed 0 to 15"),
    (("all", "STATUS"), "board all: allowed 0 to 15"),
])
def test_wrong_words_are_misuse_before_the_bus_is_asked(words: tuple[str, ...], reported: str) -> None:
    assert reported in run("read", "udp:127.99.0.1", *words, code=2).stderr


# -- write -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_write_shows_old_and_new_value(desk_bus: Recorded) -> None:
    result = run("write", desk_bus.name, 3, "WATCHDOG", "0x2580", "--yes")
    assert "now 0x00001680  30 ms" in result.stderr and "new 0x00002580  50 ms" in result.stderr
    assert "board 3 now reads 0x00002580  50 ms" in result.stdout
    assert rows("read", desk_bus.name, 0, "WATCHDOG")[0]["value"] == registers.WATCHDOG_POWER_UP  # the other board


@pytest.mark.slow
def test_all_writes_to_every_board(desk_bus: Recorded) -> None:
    found = rows("write", desk_bus.name, "all", "WATCHDOG", "9600", "--yes")
    assert [(row["board"], row["old"], row["value"]) for row in found] == [(0, 0x1680, 9600), (3, 0x1680, 9600)]


def test_write_without_terminal_needs_yes() -> None:
    assert "--yes writes without asking" in run("write", "udp:127.99.0.1", 0, "WATCHDOG", 0, code=2).stderr


@pytest.mark.parametrize("value", ["0x100000000", "ten", "1.5"])
def test_value_that_is_no_quadlet_is_misuse(value: str) -> None:
    assert "allowed 0 to 0xFFFFFFFF" in run("write", "udp:127.99.0.1", 0, "WATCHDOG", value, "--yes", code=2).stderr


def test_writing_every_axis_at_once_is_misuse() -> None:
    assert "which axis?" in run("write", "udp:127.99.0.1", 0, "ENCODER_PRELOAD", 0, "--yes", code=2).stderr


@pytest.mark.slow
@pytest.mark.parametrize(("answer", "code", "after"), [("y", 0, 0x2580), ("n", 1, 0x1680)])
def test_write_asks_at_a_terminal(desk_bus: Recorded, answer: str, code: int, after: int) -> None:
    ours, theirs = pty.openpty()
    tool = ("from trocar.tools import cli; from trocar.tools.inspect import bus_client; "
            f"bus_client.SERVER = {bus_client.SERVER}; cli.main()")
    words = ["bus", "write", desk_bus.name, "0", "WATCHDOG", "0x2580"]
    child = subprocess.Popen([sys.executable, "-c", tool, *words], stdin=theirs, stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True)
    try:
        os.write(ours, f"{answer}\n".encode())
        _, reported = child.communicate(timeout=60)
    finally:
        os.close(ours)
        os.close(theirs)
    assert "Write it?" in reported and child.returncode == code
    assert rows("read", desk_bus.name, 0, "WATCHDOG")[0]["value"] == after


@pytest.mark.slow
@pytest.mark.parametrize("words", [("write", 0, "WATCHDOG", 0, "--yes"), ("watch", 0, "--once")])
def test_running_io_keeps_its_bus(desk_bus: Recorded, words: tuple[Any, ...]) -> None:
    run("scan", desk_bus.name, "--no-serials")
    del desk_bus.requests[:]
    with named_port.hold(desk_bus.name):
        reported = run(words[0], desk_bus.name, *words[1:], code=1).stderr
    assert f"in use by pid {os.getpid()}" in reported
    assert not desk_bus.writes and not desk_bus.samples


@pytest.mark.slow
def test_another_host_keeps_its_bus(desk_bus: Recorded) -> None:
    stop = threading.Event()
    with port_of(desk_bus.name, (0, 3), monotonic_ns, USUAL) as port:
        port.discover()

        def drive() -> None:
            while not stop.is_set():
                port.read_all()
                pause(0.001)

        host = threading.Thread(target=drive)
        host.start()
        try:
            for _ in range(5):  # a host that a busy machine keeps from asking is none
                asked = CliRunner().invoke(APP, ["bus", "write", desk_bus.name, "0", "WATCHDOG", "0", "--yes"])
                if asked.exit_code:
                    break
        finally:
            stop.set()
            host.join()
    reported = asked.stderr
    assert "another host uses this bus" in reported and "nothing was written" in reported


# -- watch -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("hardware", "firmware", "axes"), [
    ("QLA1", 7, 4), ("QLA1", 8, 4), ("QLA1", 9, 4), ("DQLA", 8, 8), ("dRA1", 8, 10)])
def test_watch_shows_any_kind_of_board(
        monkeypatch: pytest.MonkeyPatch, hardware: str, firmware: int, axes: int) -> None:
    ask_patiently(monkeypatch, 1)
    with Recorded(controller(0, hardware, firmware)) as made:
        name = made.name.replace("udp:", "udpfw:")  # Rev 9 is a bridge where it is asked to be one
        (sample,) = rows("watch", name, 0, "--once")
    assert (sample["hardware"], sample["firmware"], len(sample["axes"])) == (hardware, firmware, axes)
    assert sample["axes"][0]["encoder_counts"] == 0 and sample["axes"][0]["amplifier"] == "off"
    assert sample["axes"][0]["velocity_counts_s"] == 0
    assert sample["power"] is False and sample["watchdog_tripped"] is True
    assert sample["watchdog_s"] == pytest.approx(0.03)
    if hardware == "QLA1":
        assert sample["celsius"] == [30.0, 31.0]


@pytest.mark.slow
def test_watching_writes_nothing(desk_bus: Recorded) -> None:
    run("scan", desk_bus.name, "--no-serials")
    del desk_bus.requests[:]
    assert "board 0" in run("watch", desk_bus.name, 0, "--once").stdout
    assert desk_bus.samples and not desk_bus.writes


def test_watching_stops_when_another_program_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    words = [0] * samples.layout(QLA).read_quads  # time since the sample before: one tick
    monkeypatch.setattr(samples, "take", lambda desk, board: samples.sample_of(board, words, 0))
    watching = bus.Watching(None, QLA)  # type: ignore[arg-type]  # nothing is asked
    watching.sample()
    with pytest.raises(Problem, match="another host samples board 2"):
        for _ in range(bus.FOREIGN_SAMPLES):
            pause(0.001)
            watching.sample()


# -- help --------------------------------------------------------------------------------------------------------------


def test_every_part_of_bus_has_help_with_an_example() -> None:
    for part in next(verb for verb in cli.VERBS if verb.name == "bus").parts:
        text = " ".join(run(part.name, "--help").output.split())
        assert f"Example: trocar bus {part.name}" in text
