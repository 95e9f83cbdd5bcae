"""Raw Ethernet of emulated boards: a socket that receives the frames for their MAC addresses and answers from them.

It has the methods of a socket that `endpoints` uses, with datagrams instead of frames.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable, Sequence
from typing import cast

from trocar.procs.boards.controllers.bus import GROUP
from trocar.procs.fpga import wire

SOL_PACKET, PACKET_ADD_MEMBERSHIP, PACKET_PROMISCUOUS = 263, 1, 1  # Linux; the socket module has no names for them
_HEAD = wire.FRAME_HEADER_BYTES

Host = tuple[bytes, int]  # MAC address, and the board it addressed


class FrameSocket:
    """All boards of a bus at one network interface. `to` is for which of them the newest frame was."""

    def __init__(self, interface: str, boards: Iterable[int], hub: int, *, by_board: bool) -> None:
        """OSError if there is no such interface, or it may not be used. `by_board`: every board is plugged in."""
        self._boards = frozenset(boards) if by_board else frozenset((hub,))
        self._by_board, self._hub = by_board, hub
        self.to = GROUP
        self._head = bytearray(_HEAD)
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)
        try:
            self._socket.bind((interface, wire.PLAIN_FRAMES))
            request = socket.if_nametoindex(interface).to_bytes(4, "little") + PACKET_PROMISCUOUS.to_bytes(4, "little")
            self._socket.setsockopt(SOL_PACKET, PACKET_ADD_MEMBERSHIP, request + bytes(8))
        except OSError:
            self._socket.close()
            raise

    def fileno(self) -> int:
        """For select."""
        return self._socket.fileno()

    def recvmsg_into(self, buffers: Sequence[bytearray],
                     ancillary: int) -> tuple[int, list[tuple[int, int, bytes]], int, Host]:
        """As of a socket: the size of a datagram (0: not a frame for us), its time, and its sender."""
        size, times, flags, _ = self._socket.recvmsg_into((self._head, *buffers), ancillary)
        head = bytes(self._head)
        length = int.from_bytes(head[12:14], "big")
        board = self._addressed(head[:6])
        if board is None or length > min(size - _HEAD, wire.FRAME_DATAGRAM_BYTES):
            return 0, times, flags, (head[6:12], self._hub)
        self.to = board
        return length, times, flags, (head[6:12], self._hub if board == GROUP else board)

    def _addressed(self, mac: bytes) -> int | None:
        if mac == wire.GROUP_MAC:
            return GROUP
        if mac[:5] != wire.BOARD_MAC or mac[5] not in self._boards:
            return None
        return mac[5] if self._by_board else GROUP

    def sendto(self, datagram: wire.Buffer, host: tuple[str | bytes, int]) -> int:
        """A frame from the board that the host addressed; from the hub if it addressed all."""
        mac, board = cast(Host, host)
        source = wire.BOARD_MAC + bytes([board])
        return self._socket.send(b"".join((mac, source, len(datagram).to_bytes(2, "big"), datagram)))

    def setsockopt(self, level: int, option: int, value: int) -> None:
        """As of a socket."""
        self._socket.setsockopt(level, option, value)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
