"""Keeping what was when something failed, or when somebody asked: one file after the other, nothing is forgotten."""

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
"""The instance of what no fault is."""
MAX_QUEUE: Final = 100
SLOW_NS: Final = 10_000_000_000
"""The disk is not waited for any longer."""
PAUSE_S: Final = 0.01


class FaultKeeper:
    """What is being kept, and what waits for its turn. `told` is called with each recording that has ended.

    Or that the disk, too slow, has not ended after so long: what is said of it must be so.
    """

    def __init__(self, folder: Path, disk: Disk, sources: SystemSources, times: LocalTimes, box: BlackBox,
                 begin_file: Callable[[FaultRecording], DiskFile], told: Callable[[FaultRecording], None]) -> None:
        """`begin_file`: see FaultRecording."""
        self._folder, self._disk, self._sources, self._times, self._box = folder, disk, sources, times, box
        self._begin_file, self._told = begin_file, told
        self._now: FaultRecording | None = None
        self._asked: list[Received] = []
        self._next: list[tuple[SeenFault, Received | None]] = []
        self._next_ns = self._since_ns = self._taken_ns = self._covered_ns = 0
        self._dropped, self._is_told = 0, False

    @property
    def is_idle(self) -> bool:
        """Nothing is being kept, nothing waits."""
        return self._now is None and not self._next

    @property
    def dropped(self) -> int:
        """Messages of its files that the disk did not take since start."""
        file = self._now.file if self._now is not None else None
        return self._dropped + (file.dropped if file is not None else 0)

    def saw(self, fault: SeenFault, asked: Received | None = None) -> None:
        """A fault, or somebody's wish (`asked`), which is answered when its file is written. ValueError: too many."""
        if self._now is not None and self._now.takes_more:
            self._now.add(fault)
            self._asked += [asked] if asked is not None else []
            return
        if fault.code and (fault.instance, fault.reason) in [(each.instance, each.reason) for each, _ in self._next]:
            return  # the same error once more
        if len(self._next) >= MAX_QUEUE:
            raise ValueError(f"{MAX_QUEUE} wait to be kept already")
        self._next_ns = self._next_ns if self._next else self._times.monotonic_ns
        self._next.append((fault, asked))
        if self._now is None:
            self._begin(0)

    def _begin(self, since_ns: int) -> None:
        """With all that waits. `since_ns`: what of the black box is older (time of day) was kept just before."""
        (first, _), *others = self._next
        self._now = FaultRecording(first, self._sources, self._times, self._begin_file, self._next_ns)
        for fault, _ in others:
            self._now.add(fault)
        self._asked = [asked for _, asked in self._next if asked is not None]
        self._since_ns = 0 if self._asked else since_ns
        self._next, self._taken_ns, self._is_told = [], 0, False

    def step(self, compression: str, keep: int, hurry: bool = False) -> None:
        """What there is time for; `keep`: so many files stay."""
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
        """What became of its file, to everybody and to whoever asked for it."""
        self._is_told = True
        self._told(fault)
        asked, self._asked = self._asked, []
        for request in asked:
            if file.is_complete:
                request.done(f"kept in {file.path}")
            else:
                request.fail(f"not all of it could be written: {file.problem or 'the disk is too slow'}")

    def end(self, compression: str, keep: int, seconds: float) -> None:
        """Nothing more comes: keep what is wanted, so long at most; what is not taken by then is left out.

        `close` says what became of it, when the disk has done what it could.
        """
        end_ns = monotonic_ns() + round(seconds * 1e9)
        while not self.is_idle and monotonic_ns() < end_ns:
            self._times.look()
            self.step(compression, keep, hurry=True)
            if self._taken_ns:
                pause(PAUSE_S)  # only the disk is waited for
        if self._now is not None and not self._taken_ns:
            self._finish(self._now, keep)

    def close(self) -> None:
        """Tell the last that is known."""
        if self._now is not None and not self._is_told and self._now.file is not None:
            self._tell(self._now, self._now.file)
        for request in (*self._asked, *(asked for _, asked in self._next if asked is not None)):
            request.fail("the recorder ends")
        if self._now is not None:
            self._now.close()
