"""The memory of an instrument (DS2505, 2 KiB): its layout, and the commands to read it.

One chunk of 256 bytes from `RECORD_AT` on holds all data. These bytes have no checksum against a bad contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MEMORY_BYTES: Final = 2048
CHUNK_BYTES: Final = 256
COMPANY: Final = b"997"  # begins the company statement
COMPANY_AT, MODEL_AT, VERSION_AT, NAME_AT, NAME_END = 0x80, 0xA4, 0xA8, 0x160, 0x17C
RECORD_AT: Final = COMPANY_AT

# control and status register
READ: Final = 2  # a chunk, from the address in bits 26:16 on
RELEASE: Final = 0  # the line
RELEASE_CONVERTER: Final = 8  # the same where a DS2480B drives the line
ADDRESS_SHIFT: Final = 16
BUSY: Final = 0x20F0
CONVERTER: Final = 1 << 15
RESET_SHIFT: Final = 1  # two bits: whether a memory answered
ANSWERED, SILENT = 1, 3


@dataclass(frozen=True, slots=True)
class Instrument:
    """One instrument, from its memory."""

    name: str
    model: int
    version: int

    @property
    def tool(self) -> str:
        """NAME:MODEL[VERSION], the name as tool files spell it: capitals, underscores for blanks."""
        return f"{'_'.join(self.name.upper().split())}:{self.model:06d}[{self.version}]"


def instrument_of(record: bytes) -> Instrument:
    """The instrument from its memory `record`, which starts at `RECORD_AT`; ValueError explains an invalid one."""
    if len(record) != CHUNK_BYTES:
        raise ValueError(f"{len(record)} bytes; needed: {CHUNK_BYTES}")
    company = record[COMPANY_AT - RECORD_AT :][: len(COMPANY)]
    if company != COMPANY:
        raise ValueError(f"no instrument known here: it begins with {company!r}, not with {COMPANY!r}")
    text = record[NAME_AT - RECORD_AT : NAME_END - RECORD_AT].split(b"\0")[0].split(b"\xff")[0]
    name = text.decode("ascii", "replace").strip()
    if not name or not name.isprintable() or not name.isascii():
        raise ValueError(f"it has no readable name: {text[:16]!r}")
    at = MODEL_AT - RECORD_AT
    model = int.from_bytes(record[at + 1 : at + 4], "big")  # the first byte of four has another meaning
    return Instrument(name, model, record[VERSION_AT - RECORD_AT])
