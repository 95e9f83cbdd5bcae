"""Segments whose names another program has removed from /dev/shm while their system runs.

logind does so when a login user logs out (RemoveIPC=yes). Processes that have a segment mapped keep it. To attach, a
program needs a descriptor: the supervisor keeps one for each segment, and sends all to each trusted program that
connects to its abstract Unix socket. It reads nothing from these connections. With a descriptor of O_PATH, opening the
file through /proc/self/fd requires the same permissions as opening it by its name.

An open descriptor keeps its file's memory allocated, even after the system has ended. A program therefore keeps the
received descriptors only if names are missing, and closes them at its next call after the supervisor has ended.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import socket
import struct
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from trocar.shm.memory import owners
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.header import SegmentError, reason
from trocar.shm.memory.names import path_of
from trocar.shm.memory.peers import groups_of, peer_of
from trocar.shm.memory.private import OURS
from trocar.shm.memory.process_start import lives, start_time

PATIENCE: Final = struct.pack("ll", 1, 0)  # s, µs: the supervisor answers within a beat
AGAIN_S: Final = 1.0  # after an answer that does not help
TOGETHER: Final = 64  # descriptors in a message; Linux allows 253
PER_BEAT: Final = 64  # answers
MAX_BYTES: Final = 1 << 16  # of the names in a message


def address(system: str) -> str:
    """The abstract Unix socket of a system's supervisor: to hold it is to hold the name."""
    return f"\0trocar~{system}"


@dataclass(slots=True)
class _Answer:
    """Descriptors of all segments of a supervisor; none if no name is missing, or if it did not answer."""

    pid: int = 0
    start: int = 0
    files: dict[str, int] = field(default_factory=dict)
    until: float = 0.0
    """Until then, names without a descriptor have none."""

    def close(self) -> None:
        """Close all descriptors."""
        files, self.files = self.files, {}
        for fd in files.values():
            os.close(fd)


class _Answers:
    """The last answer for each system."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.known: dict[str, _Answer] = {}

    def put(self, system: str, answer: _Answer) -> None:
        """The answer from now on."""
        self.drop(system)
        self.known[system] = answer

    def drop(self, system: str) -> None:
        """Forget an answer."""
        self.known.pop(system, _Answer()).close()

    def file(self, system: str, name: str) -> int:
        """The descriptor of a segment, -1: there is none."""
        for known, answer in list(self.known.items()):
            if answer.pid and not lives(answer.pid, answer.start):
                self.drop(known)
        answer = self.known.get(system, _Answer())
        is_unseen = not answer.pid  # the supervisor is in another pid namespace
        if (name not in answer.files or is_unseen) and time.monotonic() >= answer.until:
            self.put(system, answer := _asked(system))
        return answer.files.get(name, -1)

    def forked(self) -> None:
        """We are in a child: no other thread has the lock."""
        self.lock = threading.RLock()


_answers: Final = _Answers()
os.register_at_fork(after_in_child=_answers.forked)


def opened(name: str, flags: int) -> int:
    """Open a segment that has no name; FileNotFoundError: no supervisor of its system keeps it."""
    with _answers.lock:
        fd = _answers.file(name.partition("~")[2].partition("~")[0], name)
        if fd < 0:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        return os.open(OURS / str(fd), flags)


def _asked(system: str) -> _Answer:
    """The answer of the supervisor."""
    names: list[str] = []
    fds: list[int] = []
    count = pid = 0
    with (contextlib.suppress(OSError, ValueError, SegmentError),
          socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as asking):
        for option in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
            asking.setsockopt(socket.SOL_SOCKET, option, PATIENCE)
        asking.connect(address(system))  # waits while many others ask
        if (peer := peer_of(asking)).user in owners.accepted():
            pid = peer.pid
            while (message := socket.recv_fds(asking, MAX_BYTES, TOGETHER, socket.MSG_CMSG_CLOEXEC))[0]:
                fds += message[1]
                total, *some = message[0].decode(errors="replace").split()
                names, count = names + some, int(total)
    files = dict(zip(names, fds, strict=False))
    if not len(names) == len(fds) == count or all(os.path.lexists(path_of(name)) for name in names):
        files.clear()
        for fd in fds:
            os.close(fd)
    return _Answer(pid, start_time(pid), files, time.monotonic() + AGAIN_S)


class KeptSegments(Closable):
    """The supervisor's side: a descriptor of each segment, for all programs that may open it."""

    def __init__(self, held: socket.socket, system: str, files: Mapping[str, Path], group: int = -1) -> None:
        """SegmentError if the files cannot be opened.

        `held`: bound to the address, non-blocking. `group`: its members may open the segments, too.
        """
        self._held, self._system, self._group = held, system, group
        self._users = owners.accepted()  # a look-up that fails later would end the supervisor
        self._own = _Answer(os.getpid(), start_time(os.getpid()), until=math.inf)
        try:
            for name, file in files.items():
                self._own.files[name] = os.open(file, os.O_PATH | os.O_NOFOLLOW | os.O_CLOEXEC)
            held.listen()
        except OSError as error:
            self._own.close()
            raise SegmentError(f"cannot keep the segments of {system} open: {reason(error)}") from None
        with _answers.lock:
            _answers.put(system, self._own)  # we need not ask ourselves

    def beat(self) -> None:
        """Answer programs that wait."""
        with contextlib.suppress(OSError):  # none waits
            for _ in range(PER_BEAT):
                peer, _ = self._held.accept()
                with peer, contextlib.suppress(OSError):  # it has gone
                    peer.setblocking(False)
                    if peer_of(peer).user in self._users or self._group in groups_of(peer):
                        self._send_to(peer)

    def _send_to(self, peer: socket.socket) -> None:
        names = list(self._own.files)
        for begin in range(0, len(names), TOGETHER):
            some = names[begin : begin + TOGETHER]
            text = " ".join([str(len(names)), *some])
            socket.send_fds(peer, [text.encode()], [self._own.files[name] for name in some])

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self._own.files)

    def removed(self) -> list[str]:
        """The segments whose names are gone."""
        return [name for name, fd in self._own.files.items() if not os.fstat(fd).st_nlink]

    def close(self) -> None:
        """Close all descriptors; from now on, connections are refused."""
        self._held.shutdown(socket.SHUT_RDWR)
        with _answers.lock:
            _answers.drop(self._system)
            self._own.close()
