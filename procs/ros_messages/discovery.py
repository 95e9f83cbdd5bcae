"""What DDS participants announce (DDSI-RTPS 2.3, 8.5 and 9.6.2): their addresses, and their endpoints."""

from __future__ import annotations

import socket
import struct
from contextlib import suppress
from typing import Final

from trocar.procs.ros_messages import rtps
from trocar.procs.ros_messages.rtps import Parameters, Submessage

SPDP_WRITER, SPDP_READER = b"\0\1\0\xc2", b"\0\1\0\xc7"
WRITERS_OUT, WRITERS_IN = b"\0\0\3\xc2", b"\0\0\3\xc7"  # SEDP: which writers there are
READERS_OUT, READERS_IN = b"\0\0\4\xc2", b"\0\0\4\xc7"
SEDP: Final = {WRITERS_OUT: WRITERS_IN, READERS_OUT: READERS_IN}
ENDPOINTS: Final = 0x3F  # SPDP and SEDP, both ways
# Parameters of discovery (9.6.2.2)
LEASE, TOPIC, TYPE, VERSION, VENDOR, RELIABILITY, DURABILITY, USER_DATA = 0x02, 0x05, 0x07, 0x15, 0x16, 0x1A, 0x1D, 0x2C
ENDPOINT_LOCATOR, USER_LOCATOR, META_LOCATOR = 0x2F, 0x31, 0x32
PARTICIPANT_GUID, ENDPOINT_SET, ENDPOINT_GUID, KEY_HASH, STATUS = 0x50, 0x58, 0x5A, 0x70, 0x71
LEASE_S: Final = 20
PARTICIPANT: Final = b"\0\0\1\xc1"
LIST: Final = b"\0\3\0\0"
"""Encapsulation of a list of parameters."""
RELIABLE: Final = struct.pack("<IiI", 2, 0, 429496730)  # it blocks for 0.1 s at most, in 2⁻³² s
VOLATILE: Final = bytes(4)
Address = tuple[str, int]


def participant(prefix: bytes, host: str, meta_port: int, user_port: int) -> bytes:
    """SPDP: a participant with its ports for discovery and for messages."""
    locators = [(key, struct.pack("<iI12x4s", 1, port, socket.inet_aton(host)))
                for key, port in ((META_LOCATOR, meta_port), (USER_LOCATOR, user_port))]
    return LIST + rtps.listed([
        (VERSION, rtps.HEADER[4:6]), (VENDOR, rtps.HEADER[6:8]), (PARTICIPANT_GUID, prefix + PARTICIPANT), *locators,
        (LEASE, struct.pack("<iI", LEASE_S, 0)), (ENDPOINT_SET, struct.pack("<I", ENDPOINTS))])


def departure(prefix: bytes) -> tuple[bytes, Parameters]:
    """SPDP: a participant leaves; the message, and what stands beside it."""
    return LIST + rtps.listed([(PARTICIPANT_GUID, prefix + PARTICIPANT)]), [(STATUS, b"\0\0\0\3")]


def endpoint(prefix: bytes, entity: bytes, topic: str, kind: str, user_data: str) -> bytes:
    """SEDP: a reliable reader or writer; `kind` is the name of its type."""
    data = user_data.encode()
    return LIST + rtps.listed([
        (ENDPOINT_GUID, prefix + entity), (PARTICIPANT_GUID, prefix + PARTICIPANT), (TOPIC, rtps.text(topic)),
        (TYPE, rtps.text(kind)), (DURABILITY, VOLATILE), (RELIABILITY, RELIABLE),
        (USER_DATA, struct.pack("<I", len(data)) + data), (KEY_HASH, prefix + entity)])


def lease_of(rows: Parameters, order: str) -> int:
    """How long a participant may be silent before it counts as gone, s."""
    return next((int(struct.unpack_from(order + "i", value)[0]) for key, value in rows if key == LEASE), LEASE_S)


def has_left(one: Submessage) -> bool:
    """Whether a discovery message says that its subject is disposed of, or unregistered."""
    return any(key == STATUS and len(value) == 4 and value[3] & 3 for key, value in one.inline)


def rows_of(payload: bytes) -> Parameters:
    """The parameters of a message; none where it has none."""
    with suppress(ValueError, struct.error):
        return rtps.described(payload)[0]
    return []


def locator(rows: Parameters, wanted: int, order: str, host: str) -> Address | None:
    """An IPv4 address in a list of parameters, that of `host` if there; None: there is none."""
    found = []
    for key, value in rows:
        if key == wanted and len(value) == 24:
            kind, port = struct.unpack_from(order + "iI", value)
            if kind == 1 and 0 < port < 1 << 16:
                found.append((socket.inet_ntoa(value[20:24]), port))
    return next((each for each in found if each[0] == host), found[0] if found else None)
