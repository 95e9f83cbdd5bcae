"""Emulated controllers behind every kind of port, and what can go wrong on the way, for the conformance test."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.io.stub_bus import own_address
from trocar.procs.boards.controllers.bus import GROUP, EmulatedBus
from trocar.procs.boards.endpoints import Endpoints
from trocar.procs.document import system as document
from trocar.procs.document.system import Controller
from trocar.procs.fpga import wire
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.bus.named_port import named, transport_of
from trocar.procs.io.bus.protocols import BROADCAST_QUERY
from trocar.procs.io.bus.transport import Transport

ROOT = Path(__file__).resolve().parents[2]
TICKS_PER_NS = 49.152e-3
SERVE_NS = 5_000_000
OUR_END, OTHER_END = "trocar0", "trocar1"  # of a virtual cable in the test's own network namespace
CABLE = (f"ip link add {OUR_END} type veth peer name {OTHER_END} && ip link set {OUR_END} up && "
         f"ip link set {OTHER_END} up")
WITHOUT = "without FireWire"
Replies = list[bytes]
Fault = Callable[[bytes, Replies], Replies]


def nothing_wrong(_request: bytes, replies: Replies) -> Replies:
    return replies


def block_address() -> str:
    """The first of sixteen addresses in 127/8 that no other process or test uses."""
    head, _, last = own_address().rpartition(".")
    return f"{head}.{16 * (1 + int(last) % 14)}"


class PortBench:
    """Controllers on one bus; a context manager. `fault` may change what they reply; `requests` is what they heard.

    `kind`: udp (Rev 8), udpfw (Rev 9 as a bridge), udp without FireWire (Rev 9); the same with eth.
    """

    def __init__(self, kind: str, *, count: int = 3, serve: bool = True) -> None:
        self.kind = kind
        word, _, without = kind.partition(" ")
        late = bool(without) or word in ("udpfw", "ethfw")
        rows = tuple(Controller(board, firmware=9 if late else 8, fpga="V3" if late else "V2")
                     for board in range(2, 2 + count))
        self.network = "ethernet" if without else "bridge"
        self.bus = EmulatedBus(rows, network=self.network)
        self.ids = tuple(row.board_id for row in rows)
        self.fault: Fault = nothing_wrong
        self.requests: list[bytes] = []
        self.lock = threading.Lock()
        self._controllers = rows
        self._start_ns = time.monotonic_ns()
        self._second: bytes | None = None
        self._stop = threading.Event()
        self._endpoints = self._served() if serve else None
        self._thread = threading.Thread(target=self._serve, daemon=True)

    # -- the boards' side ----------------------------------------------------------------------------------------------

    def _served(self) -> Endpoints:
        word = self.kind.partition(" ")[0]
        raw = word.startswith("eth")
        address = f"eth:{OTHER_END}" if raw else block_address()
        self.name = f"{word}:{OUR_END if raw else address}"
        described = document.BusConfig("bench", address, self._controllers, network=self.network)
        return Endpoints((described,), self._answer, time.monotonic_ns, False)

    def _answer(self, _bus: int, data: wire.Buffer, _now_ns: int, to: int) -> wire.Buffer | None:
        replies = self.answer(bytes(data), to)
        return replies[0] if replies else None

    def answer(self, request: bytes, to: int = GROUP) -> Replies:
        """What the boards reply, with what goes wrong on the way."""
        with self.lock:
            self.requests.append(request)
            tick = round((time.monotonic_ns() - self._start_ns) * TICKS_PER_NS)
            reply = self.bus.answer(request, tick, to)
            return self.fault(request, [] if reply is None else [bytes(reply)])

    def _serve(self) -> None:
        assert self._endpoints is not None
        while not self._stop.is_set():
            self._endpoints.serve(SERVE_NS)

    def __enter__(self) -> PortBench:
        if self._endpoints is not None:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        if self._endpoints is not None:
            self._thread.join()
            self._endpoints.close()

    # -- what happens --------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """A FireWire bus reset."""
        with self.lock:
            self.bus.reset()

    def take_away(self, board: int, *, gone: bool = True) -> None:
        with self.lock:
            self.bus.take_away(self.ids.index(board), gone)

    # -- the host's side -----------------------------------------------------------------------------------------------

    def transport(self) -> Transport:
        return transport_of(named(self.name))

    def port(self, protocol: str = BROADCAST_QUERY, boards: tuple[int, ...] | None = None, **options) -> BusPort:
        options.setdefault("deadline_ms", 200)  # of a busy machine; the rules are the same
        options.setdefault("exclusive", False)
        name = named(self.name)
        return BusPort(self.transport(), self.ids if boards is None else boards, time.monotonic_ns,
                       PortOptions(protocol, bridge=name.bridge, **options))


def times(count: int, kind: Fault) -> Fault:
    """So many replies go through `kind`; then nothing is wrong any more."""
    left = [count]

    def fault(request: bytes, replies: Replies) -> Replies:
        if not replies or not left[0]:
            return replies
        left[0] -= 1
        return kind(request, replies)

    return fault


def in_namespace() -> bool:
    """Whether this is the test's own network namespace, where the virtual cable is."""
    return os.environ.get("TROCAR_TEST_CABLE") == "1"


def run_in_namespace(*command: str) -> subprocess.CompletedProcess[str]:
    """Run a command where a virtual cable is the only network; the test is skipped where that is not permitted."""
    if shutil.which("unshare") is None or shutil.which("ip") is None:
        pytest.skip("needs unshare (util-linux) and ip (iproute2)")
    made = subprocess.run(["unshare", "-rn", "sh", "-c", CABLE], capture_output=True, text=True, check=False)
    if made.returncode:
        pytest.skip(f"no network namespace for this user: {made.stderr.strip()}")
    return subprocess.run(["unshare", "-rn", "sh", "-c", f'{CABLE} && exec "$@"', "sh", *command], capture_output=True,
                          text=True, check=False, env={**os.environ, "TROCAR_TEST_CABLE": "1"}, cwd=ROOT)
