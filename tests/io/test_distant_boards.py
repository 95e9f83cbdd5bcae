"""UDP to controllers that are not on this machine: broadcast, addresses given, multicast out of the right interface.

Runs with the conformance test, in its network namespace; the boards are in another one.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time

import pytest

from tests.io.emulated_ports import ROOT, in_namespace
from trocar.procs.fpga import blocks, registers
from trocar.procs.io.bus import discovery, link
from trocar.procs.io.bus.bus_port import PortOptions
from trocar.procs.io.bus.named_port import port_of
from trocar.procs.io.bus.protocols import PROTOCOLS

pytestmark = pytest.mark.skipif(not in_namespace(), reason="runs in the namespace of the conformance test")

IDS = (2, 3, 5)


@contextlib.contextmanager
def boards_far_away(network):
    ip("link", "add", "near", "type", "veth", "peer", "name", "far")
    command = ["unshare", "-n", sys.executable, "-m", "tests.io.distant_boards", "far", network, *map(str, IDS)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as served:
        try:
            ip("addr", "add", "169.254.0.1/16", "brd", "+", "dev", "near")
            ip("link", "set", "near", "up")
            deadline = time.monotonic() + 20.0
            while subprocess.run(["ip", "link", "set", "far", "netns", str(served.pid)], check=False,
                                 capture_output=True).returncode or "far" in links():
                assert time.monotonic() < deadline
            assert served.stdout.readline() == "serving\n"
            yield
        finally:
            served.stdin.close()
            served.wait()
            # the far end goes with its namespace, some time soon
            subprocess.run(["ip", "link", "del", "near"], check=False, capture_output=True)


def ip(*words):
    subprocess.run(["ip", *words], check=True)


def links():
    return subprocess.run(["ip", "-o", "link"], check=True, capture_output=True, text=True).stdout


@pytest.mark.parametrize("network", ["ethernet", "bridge"])
def test_boards_behind_a_cable_are_found_and_driven_at_the_usual_address(network, monkeypatch):
    monkeypatch.setattr(link, "SETUP_TIMEOUT_MS", 500)  # of a busy machine
    monkeypatch.setattr(discovery, "SCAN_TIMEOUTS_MS", (200, 500))
    monkeypatch.setattr(discovery, "NODES", IDS[-1] + 1)
    with boards_far_away(network):
        for protocol in PROTOCOLS:
            port = port_of("udp", IDS, time.monotonic_ns, PortOptions(protocol))
            port._link.cycle_timeout_ms = 200
            with contextlib.closing(port):
                found = port.discover()
                assert [info.board for info in found] == list(IDS)
                assert any(port.read_all() for _ in range(20))
                status = port.blocks[:, blocks.STATUS]
                assert [registers.board_of(int(word)) for word in status] == list(IDS)
                port.out[:, -1] = registers.CONTROL_RELAY_ON
                assert port.write_all()
                assert all(port.read_quadlet(board, registers.STATUS) & registers.STATUS_RELAY for board in IDS)
            with contextlib.closing(port_of("udp", (), time.monotonic_ns, PortOptions(quiet=True))) as quiet:
                assert [info.board for info in quiet.discover()] == list(IDS)
