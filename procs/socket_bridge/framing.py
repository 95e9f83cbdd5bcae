"""Messages in a stream of bytes: lines, or frames of a WebSocket. Pure: bytes in, messages and bytes out."""

from __future__ import annotations

from typing import Final, Protocol

from websockets.exceptions import InvalidState
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import State
from websockets.server import ServerProtocol

from trocar.procs.crtk.messages import MAX_BYTES

HTTP: Final = b"GET "
TOO_LONG: Final = f"a message has {MAX_BYTES} bytes at most"


class Ended(Exception):
    """The stream ends here; the text gives the reason, unless the client already has it."""


class Framing(Protocol):
    """One way to put messages into a stream."""

    def feed(self, data: bytes) -> list[bytes]:
        """The messages that are whole now; Ended when there will be no more."""

    def frame(self, message: bytes) -> bytes:
        """A message as it goes out; empty when nothing can any more."""

    def waiting(self) -> bytes:
        """Bytes to be sent besides messages."""


class LineFraming:
    """A message a line."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that are whole now, but empty ones; Ended when one is too long."""
        self._rest += data
        if b"\n" not in data and len(self._rest) <= MAX_BYTES:
            return []
        *lines, rest = self._rest.split(b"\n")
        self._rest = bytearray(rest)
        if len(rest) > MAX_BYTES or any(len(line) > MAX_BYTES for line in lines):
            raise Ended(TOO_LONG)
        return [bytes(line) for line in lines if line.strip()]

    def frame(self, message: bytes) -> bytes:
        """A line."""
        return message + b"\n"

    def waiting(self) -> bytes:
        """Nothing."""
        return b""


class WebSocketFraming:
    """A message a WebSocket message. Web pages are refused: a page of anybody could speak to this machine."""

    def __init__(self) -> None:
        self._protocol = ServerProtocol(origins=[None], max_size=MAX_BYTES)
        self._parts: list[bytes] = []

    def feed(self, data: bytes) -> list[bytes]:
        """The messages that are whole now; Ended when the client has left, or is no WebSocket."""
        protocol, found = self._protocol, []
        protocol.receive_data(data)
        for event in protocol.events_received():
            if isinstance(event, Request):
                protocol.send_response(protocol.accept(event))
            elif isinstance(event, Frame) and event.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
                self._parts.append(bytes(event.data))
                if event.fin:
                    found.append(b"".join(self._parts))
                    self._parts.clear()
        if not found and (protocol.close_expected() or protocol.handshake_exc is not None):
            raise Ended("")
        return found

    def frame(self, message: bytes) -> bytes:
        """A text frame, preceded by the waiting bytes."""
        if self._protocol.state is not State.OPEN:
            return b""
        try:
            self._protocol.send_text(message)
        except InvalidState:
            return b""
        return self.waiting()

    def waiting(self) -> bytes:
        """The answer to its handshake, to pings, to its end."""
        return b"".join(self._protocol.data_to_send())


def framing_of(begin: bytes) -> Framing | None:
    """Framing of a stream with this beginning; None: not known yet."""
    if begin.startswith(HTTP):
        return WebSocketFraming()
    return None if HTTP.startswith(begin) else LineFraming()
