"""A head-mounted display as a head sensor (Goovis): a USB HID device, of which one byte is not 0 while it is worn."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from trocar.procs.document.consoles import HidSensor

LONGEST: Final = 64
LOOK_AGAIN_NS: Final = 1_000_000_000
DEVICES: Final = Path("/sys/class/hidraw")
NODES: Final = Path("/dev")


def find(sensor: HidSensor, devices: Path = DEVICES, nodes: Path = NODES) -> Path | None:
    """Its device file; None when it is not plugged in."""
    wanted = f"{sensor.vendor:08X}:{sensor.product:08X}"
    for row in sorted(devices.glob("hidraw*")):
        with contextlib.suppress(OSError):
            if wanted in (row / "device" / "uevent").read_text(errors="replace").upper():
                return nodes / row.name
    return None


class Goovis:
    """Opened when plugged in; checked every second while it is not."""

    def __init__(self, sensor: HidSensor, emit: Callable[[str], None],
                 search: Callable[[HidSensor], Path | None] = find) -> None:
        """`emit` gets a sentence whenever the device connects or disconnects."""
        self._sensor, self._report, self._search = sensor, emit, search
        self._file = -1
        self._worn = False
        self._again_ns, self._reported = 0, ""

    def present(self, now_ns: int) -> bool:
        """Whether it is worn, by its newest report."""
        if self._file < 0 and now_ns >= self._again_ns:
            self._open()
            self._again_ns = now_ns + LOOK_AGAIN_NS
        if self._file >= 0:
            self._read()
        return self._worn

    def _open(self) -> None:
        path = self._search(self._sensor)
        if path is None:
            numbers = f"{self._sensor.vendor:04x}:{self._sensor.product:04x}"
            self._say(f"no head sensor (USB {numbers}) is there: the operator counts as absent")
            return
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            self._say(f"head sensor {path} cannot be opened ({error.strerror}): the operator counts as absent")
        else:
            self._say(f"head sensor {path} found")

    def _read(self) -> None:
        try:
            while report := os.read(self._file, LONGEST):
                if len(report) > self._sensor.index:
                    self._worn = report[self._sensor.index] != 0
        except BlockingIOError:
            return
        except OSError:
            pass
        self.close()  # the end of the file or an error: it was pulled out
        self._say("the head sensor is gone: the operator counts as absent")

    def _say(self, text: str) -> None:
        if text != self._reported:
            self._reported = text
            self._report(text)

    def close(self) -> None:
        """Release it."""
        self._worn = False
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
