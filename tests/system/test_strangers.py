"""Buses that are not connected to one hub: replies that come late, and from strangers."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.fpga import board_side
from tests.system.conftest import systems
from tests.system.robot import Robot, wait_for
from tests.system.samples import Records, is_well, newest, stop_boards
from trocar.procs.document.system import from_json
from trocar.procs.fpga import registers, wire
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.bench.io_loop import write_system

pytestmark = pytest.mark.slow

FORGED = 0x812345  # counts
HUB_QUADS = 33


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """IO1 does without FireWire, IO2 goes from board to board."""
    folder = tmp_path_factory.mktemp("several")
    file = write_system(folder, 2)
    system = yaml.safe_load(file.read_text())
    system["IOs"] = [{"name": "IO1", "port": "udp"},
                     {"name": "IO2", "port": "udp:169.254.0.120", "protocol": "sequential-read-write"}]
    system["arms"][1]["IO"] = "IO2"
    system["trocar"] |= {"emulation": {"period_s": 0.002, "buses": {"IO1": {"network": "ethernet"}}},
                         "io": {"period_s": 0.004}, "arm": {"period_s": 0.01},
                         "supervisor_lost_s": 60, "processes": {"boards": {"hung_s": 60}}}
    file.write_text(yaml.safe_dump(system))
    with systems(folder) as make:
        robot = make()
        robot.up(file)
        yield robot


def ports_of(address: str) -> list[int]:
    """UDP ports at an address of this machine but that of the controllers: anybody may see them."""
    wanted = socket.inet_aton(address)[::-1].hex().upper()
    rows = [line.split()[1].split(":") for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    return [int(port, 16) for at, port in rows if at == wanted and int(port, 16) != wire.UDP_PORT]


def forged(board_ids: list[int], sequence: int, label: int) -> bytes:
    """A reply to a broadcast query that has all joints elsewhere."""
    quads = []
    for board in board_ids:
        block = [0] * (HUB_QUADS - 1)
        block[0:4] = [49152, 4 << 28 | board << 24, 0, 0x3C3C]
        block[8:12] = [FORGED] * 4
        quads += [HUB_QUADS << 24 | (sequence & 0xFF) << 16 | 200, *block]
    data = np.array([*quads, 0], dtype=">u4").tobytes()
    return board_side.block_response(board_ids[0], label % wire.TL_COUNT, data, board_side.Trailer())


def test_replies_of_strangers_change_nothing(several: Robot, records: Records) -> None:
    """Somebody at 127.0.0.1 sends one a cycle, and tries labels until one fits."""
    state, events = records(several, "IO1", "state"), records(several, "IO1", "events")
    begun_ns = monotonic_ns()
    wait_for(lambda: is_well(state, begun_ns), 60, "good samples")
    bus = from_json(directory.document(several.name)).emulation.buses[0]  # type: ignore[union-attr]
    true, lie, tries = newest(state, "encoder_bits"), FORGED - registers.ENCODER_ZERO, 0
    assert bus.io == "IO1" and not (true == lie).any()
    begun_ns, was_well = monotonic_ns(), False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        sent_from = stranger.getsockname()[1]
        while tries < 4 * wire.TL_COUNT or not was_well:
            cycle = int(newest(state, "cycle"))
            tries += not (state.field("encoder_bits") == lie).any()
            reply = forged([0, 1], cycle + 1, 2 * cycle + tries // 4)
            for port in ports_of(bus.address):
                stranger.sendto(reply, (bus.address, port))
            while int(newest(state, "cycle")) == cycle:
                pause(0.0002)
            was_well = was_well or is_well(state, begun_ns)
            if monotonic_ns() - begun_ns > 60_000_000_000:
                break
    rows = state.since(begun_ns)
    false = int(((rows["encoder_bits"] == lie).any(axis=1) & rows["valid"]).sum())
    assert false == 0, f"{false} of {len(rows)} records have a false position"
    assert was_well, "good samples all the while"
    texts = [bytes(row["text"]).rstrip(b"\0").decode() for row in events.since(begun_ns)]
    text, *_ = [text for text in texts if "are ignored" in text]
    assert text.startswith(f"IO1: datagrams from 127.0.0.1:{sent_from} are ignored")


def test_boards_that_stood_still_are_heard_again(several: Robot, records: Records) -> None:
    states = [records(several, io, "state") for io in ("IO1", "IO2")]
    for seconds in (0.3, 0.8):
        stop_boards(several, seconds, states)
