"""Controllers whose firmware is newer than the captures: read if their blocks look known, powered on request only."""

from __future__ import annotations

import pytest

from tests.fpga import board_side
from tests.io.boards_harness import COARSE, BoardsHarness, Direct
from tests.io.stub_bus import bus_of, port_to
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus.protocols import SEQUENTIAL
from trocar.procs.io.bus.transport import PortError

SYSTEMS = ("demo.yaml", "demo-psm-si.yaml")


class SentDatagrams(Direct):
    """Keeps what is sent."""

    def __init__(self, *values) -> None:
        super().__init__(*values)
        self.sent: list[bytes] = []

    def send(self, datagram) -> None:
        self.sent.append(bytes(datagram))
        super().send(datagram)

    def written(self) -> set[int]:
        """The addresses of all writes."""
        requests = [board_side.decode_request(one) for one in self.sent]
        return {one.address for one in requests if one.tcode in (wire.QUADLET_WRITE, wire.BLOCK_WRITE)}


def rig(file: str, *sets: str) -> BoardsHarness:
    loaded = load_system(PROJECT_CONFIGS / "systems" / file, boards="emulated",
                         sets=[*COARSE, "emulation.firmware=10", *sets])
    assert loaded.system is not None, loaded.errors
    return BoardsHarness(loaded.system, driven=True, link=SentDatagrams)


@pytest.mark.parametrize("file", SYSTEMS)
def test_boards_with_unknown_firmware_are_read_and_get_no_write_and_no_power(file: str) -> None:
    harness = rig(file)
    assert isinstance(harness.link, SentDatagrams)
    harness.run(0.1)
    assert harness.record.valid and [event.code for event in harness.events if event.code == "firmware-unknown"]
    harness.link.sent.clear()
    for command in ("power_on", "supply_on"):
        answer = harness.do(command, "PSM1", *([5.0] if command == "supply_on" else []))
        assert answer.outcome == "refused" and "Rev 10): the bus is only read" in answer.answers[-1][1]
    harness.run(0.2)
    assert not harness.record.powered.any() and not harness.record.amp_on.any()
    assert harness.link.written() == {registers.QUERY}


def test_a_hub_with_unknown_firmware_that_no_robot_uses_counts() -> None:
    harness = rig("demo.yaml", "emulation.firmware=9",
                  "emulation.buses={IO1: {hub: 5, controllers: {5: {firmware: 10}}}}")
    assert harness.port.assumed == (5,) and harness.port.read_only
    assert harness.do("power_on", "PSM1").outcome == "refused"


def test_they_get_power_where_the_operator_has_configured_it() -> None:
    harness = rig("demo.yaml", "io.unknown_firmware=true")
    harness.bring_up("PSM1")
    assert harness.record.amps_on.all() and not harness.port.read_only
    assert [event.code for event in harness.events if event.code == "firmware-unknown"]


def test_blocks_that_are_not_those_of_rev_9_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with bus_of(2, firmware=10) as bus, port_to(bus) as port:
        port.discover()
        assert port.assumed == (0, 1) and port.read_only
        usual = bus._hub_block
        monkeypatch.setattr(bus, "_hub_block", lambda *values: (38 << 24 | int.from_bytes(usual(*values)[:4], "big")
                                                                & 0xFF_FFFF).to_bytes(4, "big") + usual(*values)[4:])
        with pytest.raises(PortError, match=r"Rev 10\) whose real-time blocks are not those of Rev 9"):
            port.discover()


def test_a_protocol_that_cannot_check_them_is_refused() -> None:
    with bus_of(1, firmware=10) as bus, port_to(bus, SEQUENTIAL) as port, \
            pytest.raises(PortError, match=f"{SEQUENTIAL} cannot check"):
        port.discover()
