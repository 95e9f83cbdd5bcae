"""The description of a head sensor on USB (`consoles[].HID_file`): its USB ids, and the byte for presence."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from pydantic import Field

from trocar.procs.config.loading.context import Context
from trocar.procs.config.read.validate import Section
from trocar.procs.document.consoles import HidSensor

MAX_REPORT: Final = 64  # bytes, of a full-speed device

UsbNumber = Annotated[str, Field(pattern=r"^(0[xX])?[0-9a-fA-F]{1,4}$", description="up to four hexadecimal digits")]


class HidFile(Section):
    """Keys as in the original's `share/hid`; USB numbers are texts of up to four hexadecimal digits."""

    id_vendor: UsbNumber
    id_product: UsbNumber
    index_data: Annotated[int, Field(ge=0, lt=MAX_REPORT)]


def load_hid(context: Context, path: Path) -> HidSensor | None:
    """The sensor that a file describes; None, with errors, when the file is not valid."""
    opened = context.open(HidFile, path)
    if opened is None:
        return None
    content = opened.content
    return HidSensor(int(content.id_vendor, 16), int(content.id_product, 16), content.index_data)
