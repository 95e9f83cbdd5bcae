"""Keeps recordings of faults, and those on request, in one file after the other; requests wait in a queue."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from trocar.procs.recorder.box import BlackBox
from trocar.procs.recorder.disk import Disk, DiskFile
from trocar.procs.recorder.fault import FaultRecording
from trocar.procs.recorder.sources import LocalTimes, SystemSources
from trocar.procs.recorder.watch import SeenFault
from trocar.shm.mailbox.received import Received
from trocar.shm.time.clock import monotonic_ns, pause

ASKED: Final = "asked"
"""The instance of a request without a fault."""
MAX_QUEUE: Final = 100
SLOW_NS: Final = 10_000_000_000
"""Longest wait for the disk."""
PAUSE_S: Final = 0.01


class FaultKeeper:
    """The recording in progress, and the queue. `told` is called with each recording that has ended.

    Also with one that a slow disk has not ended after SLOW_NS: the report must be true.
    """

    def __init__(self, folder: Path, disk: Disk, sources: SystemSources, times: LocalTimes, box: BlackBox,
                 begin_file: Callable[[FaultRecording], DiskFile], told: Callable[[FaultRecording], None]) -> None:
        """`begin_file`: see FaultRecording."""
        self._folder, self._disk, self._sources, self._times, self._box = folder, disk, sources, times, box
        self._begin_file, self._told = begin_file, told
        self._now: FaultRecording | None = None
        self._asked: list[Received] = []
        self._next: list[tuple[SeenFault, Received | None]] = []
        self._next_since = times.now
        self._since_ns = self._taken_ns = self._covered_ns = 0
        self._dropped, self._is_told = 0, False

    @property
    def is_idle(self) -> bool:
        """Whether there is no recording in progress and none in the queue."""
        return self._now is None and not self._next

    @property
    def dropped(self) -> int:
        """Number of messages dropped since start."""
        file = self._now.file if self._now is not None else None
        return self._dropped + (file.dropped if file is not None else 0)

    def saw(self, fault: SeenFault, asked: Received | None = None) -> None:
        """Take a fault, or a request (`asked`), which is answered after its file is written. ValueError: queue full."""
        if self._now is not None and self._now.takes_more:
            self._now.add(fault)
            self._asked += [asked] if asked is not None else []
            return
        if fault.code and (fault.instance, fault.reason) in [(each.instance, each.reason) for each, _ in self._next]:
            return  # a repetition of an error in the queue
        if len(self._next) >= MAX_QUEUE:
            raise ValueError(f"{MAX_QUEUE} are already waiting to be saved")
        self._next_since = self._next_since if self._next else self._times.now
        self._next.append((fault, asked))
        if self._now is None:
            self._begin(0)

    def _begin(self, since_ns: int) -> None:
        """Begin with the whole queue. `since_ns` (time of day): older data of the black box is in the last file."""
        (first, _), *others = self._next
        self._now = FaultRecording(first, self._sources, self._times, self._begin_file, self._next_since)
        for fault, _ in others:
            self._now.add(fault)
        self._asked = [asked for _, asked in self._next if asked is not None]
        self._since_ns = 0 if self._asked else since_ns
        self._next, self._taken_ns, self._is_told = [], 0, False

    def step(self, compression: str, keep: int, hurry: bool = False) -> None:
        """Do the next part of the work; `keep`: number of files to keep."""
        fault = self._now
        if fault is None:
            return
        if not self._taken_ns:
            if fault.step(compression, hurry):
                self._finish(fault, keep)
            return
        is_late = self._times.monotonic_ns >= self._taken_ns + SLOW_NS
        if not self._is_told and fault.file is not None and (fault.file.is_ended or is_late):
            self._tell(fault, fault.file)
        if self._is_told and (fault.is_quiet or hurry):
            self._dropped, self._now = self.dropped, None
            if self._next:
                self._begin(self._covered_ns)

    def _finish(self, fault: FaultRecording, keep: int) -> None:
        self._box.flush()
        self._taken_ns, self._covered_ns = self._times.monotonic_ns, self._times.local_ns
        fault.finish(self._folder, self._disk, [file.path for file in self._box.files], keep, self._since_ns)

    def _tell(self, fault: FaultRecording, file: DiskFile) -> None:
        """Report the result, and answer the requests for it."""
        self._is_told = True
        self._told(fault)
        asked, self._asked = self._asked, []
        for request in asked:
            if file.is_complete:
                request.done(f"kept in {file.path}")
            else:
                request.fail(f"not all of it could be written: {file.problem or 'the disk is too slow'}")

    def end(self, compression: str, keep: int, seconds: float) -> None:
        """Finish the queue at the end of the process, within `seconds`; later records are left out.

        `close` reports the result after the disk has done its part.
        """
        end_ns = monotonic_ns() + round(seconds * 1e9)
        while not self.is_idle and monotonic_ns() < end_ns:
            self._times.look()
            self.step(compression, keep, hurry=True)
            if self._taken_ns:
                pause(PAUSE_S)  # waits for the disk only
        if self._now is not None and not self._taken_ns:
            self._finish(self._now, keep)

    def close(self) -> None:
        """Report the present result, and fail the remaining requests."""
        if self._now is not None and not self._is_told and self._now.file is not None:
            self._tell(self._now, self._now.file)
        for request in (*self._asked, *(asked for _, asked in self._next if asked is not None)):
            request.fail("the recorder ends")
        if self._now is not None:
            self._now.close()
