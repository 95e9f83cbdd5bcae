"""Structures of the kernel's FireWire devices."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.io.fake_firewire import encoded
from trocar.procs.io.bus import cdev as firewire
from trocar.procs.io.bus.cdev import BusReset, CdevResponse

RESPONSE_DATA_AT = firewire._RESPONSE.size
HEADER = Path("/usr/include/linux/firewire-cdev.h")
FACTS = {  # as the C compiler has it on x86-64
    "sizeof(struct fw_cdev_get_info)": firewire.INFO_BYTES,
    "sizeof(struct fw_cdev_send_request)": firewire.REQUEST_BYTES,
    "sizeof(struct fw_cdev_event_bus_reset)": firewire.RESET_BYTES,
    "offsetof(struct fw_cdev_event_response, data)": RESPONSE_DATA_AT,
    "sizeof(struct fw_cdev_event_response)": 24,
    "offsetof(struct fw_cdev_get_info, bus_reset)": 16,
    "offsetof(struct fw_cdev_get_info, card)": 32,
    "offsetof(struct fw_cdev_send_request, offset)": 8,
    "offsetof(struct fw_cdev_send_request, data)": 24,
    "offsetof(struct fw_cdev_send_request, generation)": 32,
    "offsetof(struct fw_cdev_event_bus_reset, generation)": 32,
    "FW_CDEV_IOC_GET_INFO": firewire.GET_INFO,
    "FW_CDEV_IOC_SEND_REQUEST": firewire.SEND_REQUEST,
    "FW_CDEV_IOC_SEND_BROADCAST_REQUEST": firewire.SEND_BROADCAST_REQUEST,
    "FW_CDEV_EVENT_BUS_RESET": firewire.BUS_RESET,
    "FW_CDEV_EVENT_RESPONSE": firewire.RESPONSE,
    "RCODE_GENERATION": firewire.STALE_GENERATION,
}


def test_sizes_and_codes_are_those_we_wrote_down() -> None:
    assert (firewire.INFO_BYTES, firewire.REQUEST_BYTES, firewire.RESET_BYTES) == (40, 40, 40)
    assert RESPONSE_DATA_AT == 20
    codes = (firewire.GET_INFO, firewire.SEND_REQUEST, firewire.SEND_BROADCAST_REQUEST)
    assert codes == (0xC0282300, 0x40282301, 0x40282312)


def test_sizes_and_codes_are_those_of_the_kernels_header(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None or not HEADER.exists():
        pytest.skip("needs a C compiler and the kernel's headers")
    lines = "".join(f'printf("%llu\\n", (unsigned long long)({fact}));\n' for fact in FACTS)
    source = tmp_path / "facts.c"
    source.write_text(f"#include <stdio.h>\n#include <stddef.h>\n#include <{HEADER.relative_to('/usr/include')}>\n"
                      f"int main(void) {{ {lines} return 0; }}\n")
    program = tmp_path / "facts"
    subprocess.run([compiler, "-o", str(program), str(source)], check=True)
    reported = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout.split()
    assert dict(zip(FACTS, map(int, reported), strict=True)) == FACTS


NODES = st.integers(0, 0xFFFF)


@given(st.builds(BusReset, NODES, NODES, st.integers(0, 0xFFFF_FFFF)))
def test_bus_resets_survive_the_bytes(event: BusReset) -> None:
    assert firewire.decode_event(encoded(event)) == event


@given(st.builds(CdevResponse, st.integers(0, 2**64 - 1), st.integers(0, 0xFF), st.binary(max_size=2048)))
def test_responses_survive_the_bytes(event: CdevResponse) -> None:
    assert firewire.decode_event(encoded(event)) == event


@given(st.binary(max_size=64))
def test_other_bytes_are_no_event_or_one(data: bytes) -> None:
    event = firewire.decode_event(data)
    assert not isinstance(event, CdevResponse) or event.data == data[RESPONSE_DATA_AT :][: len(event.data)]
    assert event is None or len(encoded(event)) >= RESPONSE_DATA_AT


def test_short_reads_have_their_data_twice_as_the_kernel_sends_them() -> None:
    event = encoded(CdevResponse(7, 0, b"QLA1"))
    assert len(event) == 28 and event[20:24] == event[24:28] == b"QLA1"


def test_truncated_events_are_none() -> None:
    assert firewire.decode_event(encoded(BusReset(1, 2, 3))[:30]) is None
    assert firewire.decode_event(encoded(CdevResponse(1, 0, bytes(100)))[:90]) is None
    assert firewire.decode_event(b"") is None


def test_requests_and_info_have_their_fields_where_the_kernel_looks() -> None:
    request = firewire.encode_request(5, 128, 0xFFFF_F000_0400, 9, 0x7F00_0000_1000, 41)
    assert firewire._REQUEST.unpack(request) == (5, 128, 0xFFFF_F000_0400, 9, 0x7F00_0000_1000, 41)
    info = firewire.encode_info(0x1000, 0x2000)
    info[32:36] = (3).to_bytes(4, "little")
    assert len(info) == 40 and firewire.card_of(info) == 3


def test_the_vendor_stands_in_general_and_in_minimal_roms() -> None:
    general = b"".join(quad.to_bytes(4, "little") for quad in (0x0404_1234, 0x3133_3934, 0, 0xFA610E_07))
    minimal = b"".join(quad.to_bytes(4, "little") for quad in (0x01FA_610E, 0, 0, 0))
    assert firewire.vendor_of(general) == firewire.vendor_of(minimal) == firewire.VENDOR
