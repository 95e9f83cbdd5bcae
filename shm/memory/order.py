"""Memory order: requirements of the protocols here, why x86-64 meets them, and fences where a processor does not.

Needed: a process's stores to protocol words become visible in program order (with the plain bytes written between
them), and its loads happen in program order. x86-64 keeps both by itself (total store order, Intel SDM vol. 3 §9.2, AMD
APM vol. 2 §7.2): stores are not reordered with stores, loads not with loads; a store may only be overtaken by a LATER
load of another address, which does not affect the ring and the mailbox. Two details:

- A copy is many stores. Those of one `rep movs` may pass each other, but none passes a store before or behind the
  copy. Copies beyond glibc's non-temporal threshold (hundreds of kB, and never below 16 kB) are weakly ordered stores
  with an sfence behind them: they could pass an EARLIER store, a slot's BUSY mark. Writers of records that large
  therefore fence (see `ordered`).
- A word is one move: CPython reads and writes an item of a memoryview of format "Q" as one aligned 8-byte memcpy, which
  compilers turn into one instruction.

The compiler cannot reorder either: every access is a call through the interpreter.

Other processors (ARM, POWER, RISC-V) guarantee neither order. There every load and store of a protocol word is enclosed
in two full fences of libatomic: stronger and slower than needed, and easy to verify. Without libatomic a ring or
mailbox cannot be attached. TROCAR_FENCES=1 in the environment enables the fences on x86-64 too.

Where a store must not be overtaken by a later load (shm/time/wakeup.py), x86-64 needs a fence as well: `full_fence`.
"""

from __future__ import annotations

import ctypes
import os
import platform
import threading
from collections.abc import Callable
from typing import Protocol

from trocar.shm.memory.header import SegmentError

SEQUENTIALLY_CONSISTENT = 5  # memory_order_seq_cst of <stdatomic.h>
LIBRARIES = ("libatomic.so.1", "libatomic.so")
ORDERED = ("x86_64", "AMD64")
PLAIN_COPY = 0x4000  # no threshold of glibc is below 0x4040


class OrderError(SegmentError):
    """This processor may reorder our loads and stores, and no fence is available."""


class Words(Protocol):
    """Aligned 64-bit words, loaded and stored one at a time."""

    def __getitem__(self, index: int, /) -> int: ...

    def __setitem__(self, index: int, value: int, /) -> None: ...


class FencedWords:
    """Words whose every load and store is enclosed in two full fences."""

    __slots__ = ("_fence", "_words")

    def __init__(self, words: memoryview[int], fence: Callable[[], object]) -> None:
        self._words, self._fence = words, fence

    def __getitem__(self, index: int, /) -> int:
        self._fence()
        value = self._words[index]
        self._fence()
        return value

    def __setitem__(self, index: int, value: int, /) -> None:
        self._fence()
        self._words[index] = value
        self._fence()


def fences_wanted() -> bool:
    """Whether protocol words need fences: not on x86-64, unless TROCAR_FENCES=1 is set."""
    return platform.machine() not in ORDERED or os.environ.get("TROCAR_FENCES") == "1"


def ordered(words: memoryview[int], copied: int = 0) -> Words:
    """`words` as they are where the processor keeps our order, fenced elsewhere; OrderError if no fence is available.

    `copied`: the maximum number of bytes copied between two accesses; above PLAIN_COPY fences are always used.
    """
    return FencedWords(words, full_fence()) if fences_wanted() or copied > PLAIN_COPY else words


def library_fence() -> Callable[[], object]:
    """A full fence by libatomic (C11's atomic_thread_fence); OrderError without that library."""
    for name in LIBRARIES:
        try:
            fence = ctypes.CDLL(name).atomic_thread_fence
        except (OSError, AttributeError):
            continue
        fence.argtypes, fence.restype = [ctypes.c_int], None
        return lambda: fence(SEQUENTIALLY_CONSISTENT)
    raise OrderError(
        f"{platform.machine()} does not keep the order of our loads and stores, and libatomic, which has fences, is "
        "not installed; try: sudo apt-get install libatomic1"
    )


def full_fence() -> Callable[[], object]:
    """A function that orders every earlier store before every later load.

    On x86-64 one uncontended lock cycle: its acquire is a locked instruction, which is a full fence there, and it costs
    a fifth of a foreign call. Elsewhere libatomic's fence; OrderError if that is not available.
    """
    if fences_wanted():
        return library_fence()
    lock = threading.Lock()
    acquire, release = lock.acquire, lock.release

    def cycle() -> None:
        acquire()
        release()

    return cycle
