"""Potentiometer boards over Bluetooth, read by a child process: connecting takes seconds and needs an event loop.

    python -m trocar.procs.suj.bluetooth ADDRESS...

prints a line for every reading, `{"board": ADDRESS, "reading": TEXT}`, and for every change of the problem, `{"board":
ADDRESS, "problem": TEXT}`. The process ends when its output is closed. The optional package bleak does the
communication.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any, Final

POTS: Final = "babb122c-de4c-11ec-9d64-0242ac120101"  # the characteristic that holds the newest reading
PERIOD_S: Final = 0.1
RETRY_S: Final = 5.0
CONNECT_S: Final = 10.0
AGAIN_NS: Final = 30_000_000_000
MOST: Final = 65536


class BluetoothBoards:
    """The parent's end: reads the output of a child that communicates with the boards."""

    def __init__(self, addresses: Sequence[str]) -> None:
        """Start the child."""
        self._addresses = tuple(addresses)
        self._problems = {address.upper(): "not connected yet" for address in addresses}
        self._start()

    def _start(self) -> None:
        self._child = subprocess.Popen([sys.executable, "-m", "trocar.procs.suj.bluetooth", *self._addresses],
                                       stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
        if self._child.stdout is None:
            raise OSError("cannot open a pipe to the Bluetooth reader")
        self._pipe = self._child.stdout.fileno()
        os.set_blocking(self._pipe, False)
        self._left, self._ended_ns = b"", 0

    def poll(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Readings since the last call; an ended child is restarted after a while."""
        if self._ended_ns and now_ns - self._ended_ns > AGAIN_NS:
            self.close()
            self._start()
        found = []
        for line in self._lines(now_ns):
            try:
                reported = json.loads(line)
                address = str(reported["board"]).upper()
            except (ValueError, KeyError, TypeError):
                continue
            if "reading" in reported:
                self._problems[address] = ""
                found.append((address, str(reported["reading"]).encode()))
            else:
                self._problems[address] = str(reported.get("problem", ""))
        return found

    def _lines(self, now_ns: int) -> list[bytes]:
        try:
            data = os.read(self._pipe, MOST) if not self._ended_ns else b""
        except BlockingIOError:
            return []
        if not data and not self._ended_ns:
            self._ended_ns = now_ns
            ended = "the Bluetooth reader has ended"
            self._problems = {address: problem or ended for address, problem in self._problems.items()}
        *lines, self._left = (self._left + data).split(b"\n")
        self._left = self._left[-MOST:]
        return lines

    def problem(self, address: str) -> str:
        """Why a board sends no readings."""
        return self._problems.get(address.upper(), "this board is not polled")

    def close(self) -> None:
        """End the child."""
        self._child.terminate()
        if self._child.stdout is not None:
            self._child.stdout.close()
        self._child.wait()


def say(address: str, **what: str) -> None:
    """Print a line for the parent."""
    sys.stdout.write(json.dumps({"board": address, **what}) + "\n")
    sys.stdout.flush()


async def watch(client_of: Any, address: str) -> None:
    """Read one board endlessly: connect, read, and reconnect after any error."""
    import asyncio  # here, because the setup joints' process imports this module and has no use for its 3 MB

    while True:
        try:
            async with client_of(address, timeout=CONNECT_S) as client:
                while True:
                    say(address, reading=bytes(await client.read_gatt_char(POTS)).decode(errors="replace"))
                    await asyncio.sleep(PERIOD_S)
        except BrokenPipeError:
            raise
        except Exception as error:  # a Bluetooth stack may raise anything
            say(address, problem=f"{type(error).__name__}: {error}"[:150])
        await asyncio.sleep(RETRY_S)


async def watch_all(client_of: Any, addresses: Sequence[str]) -> None:
    """All boards at once."""
    import asyncio

    await asyncio.gather(*(watch(client_of, address) for address in addresses))


def main() -> None:
    """Read until the output is closed."""
    try:
        from bleak import BleakClient
    except ImportError:
        from trocar.procs.machine.extras import missing

        for address in sys.argv[1:]:
            say(address, problem=missing("bleak"))
        sys.exit(1)
    import asyncio

    try:
        asyncio.run(watch_all(BleakClient, sys.argv[1:]))
    except BrokenPipeError:
        sys.exit(0)


if __name__ == "__main__":
    main()
