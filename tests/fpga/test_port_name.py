"""Names of ports."""

from __future__ import annotations

import pytest

from tests.cases import cases
from trocar.procs.fpga.port_name import ETHERNET, FIREWIRE, UDP, PortName, PortNameError


@cases(
    ("text", "parts"),
    [
        ("udp", (UDP, "169.254.0.100", False)),
        ("udpfw:127.0.0.1", (UDP, "127.0.0.1", True)),
        ("eth", (ETHERNET, "0", False)),
        ("eth:1", (ETHERNET, "1", False)),
        ("ethfw:enp3s0", (ETHERNET, "enp3s0", True)),
        ("fw", (FIREWIRE, "0", True)),
        ("fw:01", (FIREWIRE, "1", True)),
        ("2", (FIREWIRE, "2", True)),
    ],
)
def test_names_say_by_what_where_and_whether_a_hub_bridges(text: str, parts: tuple[str, str, bool]) -> None:
    assert PortName.parse(text) == PortName(*parts)


@cases("text", ["", "udp:300.1.1.1", "udp:there", "udp:1", "fw:x", "fw:100", "eth:../x", "eth:a b",
                "eth:sixteen_letters_", "usb:1", "udp:1.2.3.4:5", "FW", "²"])
def test_other_names_are_refused_with_what_is_allowed(text: str) -> None:
    with pytest.raises(PortNameError, match="allowed: "):
        PortName.parse(text)


def test_a_port_of_the_boards_own_processor_is_refused_with_the_reason() -> None:
    with pytest.raises(PortNameError, match="processor of a controller"):
        PortName.parse("emio:0")


def test_all_names_of_one_bus_have_one_owner() -> None:
    assert PortName.parse("fw").owned == PortName.parse("0").owned == "fw:0"
    assert PortName.parse("udp").owned == PortName.parse("udpfw:169.254.0.100").owned
