"""A host that writes a thousand times without pause, faster than anybody reads: the receive buffer keeps it all."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.boards.served import Served
from trocar.procs.boards import endpoints
from trocar.procs.boards.endpoints import RECEIVE_BYTES, SO_RCVBUFFORCE
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

BURST = 1000
MOST = Path("/proc/sys/net/core/rmem_max")


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served()
    yield made
    made.close()


def test_the_largest_receive_buffer_is_granted(served: Served) -> None:
    wanted = min(RECEIVE_BYTES, int(MOST.read_text()))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain, contextlib.suppress(PermissionError):
        plain.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BYTES)
        wanted = RECEIVE_BYTES
    assert served.granted_bytes >= 2 * wanted  # the kernel doubles what is asked for


def test_a_small_receive_buffer_loses_some(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoints, "RECEIVE_BYTES", 1 << 16)
    with contextlib.closing(Served()) as served:
        assert served.granted_bytes < BURST * wire.QUADLET_RESPONSE_BYTES * 10
        for _ in range(BURST):
            served.host.send(wire.quadlet_write(0, reg.WATCHDOG, 0, 1, 1))
        for _ in range(BURST):
            served.endpoints.serve(0)
        assert 0 < served.world.buses[0].packets < BURST


def test_a_thousand_quadlet_writes_without_pause_are_all_executed(served: Served) -> None:
    generation, address = served.world.buses[0].generation, reg.axis_register(2, reg.ENCODER_PRELOAD)
    writes = [wire.quadlet_write(1, address, reg.ENCODER_ZERO + k, k % wire.TL_COUNT, generation) for k in range(BURST)]
    served.need(BURST, len(writes[0]))
    served.burst(writes)
    assert served.ask(1, address) == reg.ENCODER_ZERO + BURST - 1


def test_a_thousand_real_time_writes_without_pause_are_all_executed(served: Served) -> None:
    generation = served.world.buses[0].generation
    groups = np.zeros((2, 6), np.dtype(">u4"))
    groups[:, 0] = (3 << 8 | 6, 9 << 8 | 6)
    writes = []
    for k in range(BURST):
        groups[:, 1:5] = reg.DAC_VALID | reg.CURRENT_ZERO + k
        writes.append(wire.block_write(wire.BROADCAST, reg.REAL_TIME, groups.tobytes(), k % wire.TL_COUNT, generation))
    served.need(BURST, len(writes[0]))
    served.burst(writes)
    assert [served.ask(node, reg.axis_register(3, reg.DAC)) for node in (0, 1)] == [reg.CURRENT_ZERO + BURST - 1] * 2


def test_a_burst_and_the_table_behind_it_arrive_in_order(served: Served) -> None:
    generation = served.world.buses[0].generation
    table = np.arange(300, dtype=np.dtype(">u4")).tobytes()
    writes = [wire.quadlet_write(0, reg.WATCHDOG, k, k % wire.TL_COUNT, generation) for k in range(BURST)]
    writes.append(wire.block_write(0, reg.WAVEFORM, table, 1, generation))
    writes.append(wire.quadlet_write(0, reg.WAVEFORM, 7, 2, generation))
    served.need(BURST + 2, len(table))
    served.burst(writes)
    assert [served.ask(0, reg.WAVEFORM + k) for k in (0, 1, 299)] == [7, 1, 299]
    assert served.ask(0, reg.WATCHDOG) == BURST - 1
