"""The past of a system: what pages showed, or would have shown, at a time; from its rings, and the recorder's files.

The same sources as for the present read the records up to that time. All this runs in a thread of its own, one request
after the other, for a quarter of a core at most.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
import orjson
from numpy.typing import NDArray

from trocar.procs.document.recorder import NAME as RECORDER
from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.gui.catalogue import families_of, makers_of
from trocar.procs.gui.rings import PastReader
from trocar.procs.gui.sources import MADE, OPTIONS
from trocar.procs.gui.times import Times
from trocar.procs.recordings import names
from trocar.procs.recordings.facts import local_offset_ns
from trocar.procs.recordings.folder import kept
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns

if TYPE_CHECKING:
    from trocar.procs.gui.recorded import FaultFile, RecordedFiles, Rows

MAX_SPAN_MS: Final = 60_000
"""Of samples in one answer."""
MAX_POINTS: Final = 2000
BEFORE_NS: Final = 2_000_000_000
"""The state at a time is in the records up to so long before it; what is written on change only, in its ring."""
EVENTS_NS: Final = 20_000_000_000
"""The same for events whose ring does not go back as far."""
REST: Final = 3.0
"""Times the work of a request, until the next one begins; at most MAX_REST_S."""
MAX_REST_S: Final = 2.0
NOT_RECORDED: Final = "not recorded"
Answer = TypeVar("Answer")


class PastRings:
    """The rings of a system, each with its records from `begin_ns` up to `end_ns` (time of day)."""

    def __init__(self, files: RecordedFiles, times: Times, begin_ns: int, end_ns: int, *, is_state: bool) -> None:
        """`times`: of this run; `is_state`: nearly all rings will be read."""
        self._files, self._times, self._is_state = files, times, is_state
        self._begin_ns, self._end_ns = begin_ns, end_ns
        self._read: dict[bool, Rows] = {}
        self.is_known = False
        """Whether any periodic ring that was opened has records of this time."""

    def __call__(self, system: str, instance: str, ring: str, kind: str | None = None) -> PastReader:
        """See Rings."""
        with closing(directory.reader(system, instance, ring, kind, often=False)) as reader:
            dtype, is_periodic = reader.dtype, bool(reader.info.get("rate_hz"))
            reader.rewind()
            oldest_ns = int(self._times.local(np.array([reader.stamp_ns]))[0]) if reader.next() else 0
            has_first = reader.sequence <= 1 and not is_periodic
            if is_periodic:
                rows = (reader.since(self._times.stamp(self._begin_ns)) if oldest_ns <= self._end_ns
                        else np.zeros(0, dtype))
                if not len(rows) and self._is_state:  # its writer stalls, or is gone: shown with its age
                    rows = reader.last(1)
            else:
                rows = reader.last(reader.depth)
        has_local = "local_ns" in (dtype.names or ())
        rows["stamp_ns"] = rows["local_ns"] if has_local else self._times.local(rows["stamp_ns"])
        rows = rows[rows["stamp_ns"] <= self._end_ns]
        if oldest_ns > self._begin_ns and not (has_first and len(rows)):
            earlier = self._recorded(f"{instance}/{ring}", ring)
            if earlier is not None and earlier.dtype == dtype:
                before = earlier["stamp_ns"] < (rows["stamp_ns"][0] if len(rows) else self._end_ns + 1)
                rows = np.concatenate([earlier[before], rows])
        self.is_known = self.is_known or (is_periodic and bool(len(rows)))
        return PastReader(dtype, rows)

    def _recorded(self, topic: str, ring: str) -> NDArray[Any] | None:
        """All that may be wanted is read at once: one pass over the files."""
        if not self._is_state:
            return self._files.records(topic.__eq__, self._begin_ns, self._end_ns).get(topic)
        is_event, begin_ns = ring == "events", self._end_ns - EVENTS_NS if ring == "events" else self._begin_ns
        if is_event not in self._read:
            self._read[is_event] = self._files.records(lambda name: name.endswith("/events") == is_event, begin_ns,
                                                       self._end_ns)
        return self._read[is_event].get(topic)


class Past:
    """Answers what was at a time. Open until closed; files are opened at the first request."""

    def __init__(self, document: SystemConfig, folder: Path | None, frozen: bytes) -> None:
        """`folder`: of the recordings, None without a recorder; `frozen`: the document as it is in recordings."""
        self._document, self._folder, self._frozen = document, folder, frozen
        self._work = ThreadPoolExecutor(1, "past")
        self._is_over, self._rested_s = threading.Event(), 0.0
        self._files: RecordedFiles | None = None
        self.begin_ns = 0
        """Begin of the black box (time of day), and recordings of faults, when they were last looked for."""
        self.faults: Sequence[FaultFile] = ()

    def ask(self, parts: Mapping[str, Any], number: Any) -> Future[bytes]:
        """The message with the answer to a page's request, as soon as it is its turn; ValueError for a wrong one."""
        at, begin, end = parts["at"], parts["from"], parts["to"]
        if not 0 <= end - begin <= MAX_SPAN_MS:
            raise ValueError(f"samples of {MAX_SPAN_MS // 1000} s at most")
        if sum(":" in name or "/trace" in name for name in parts["sources"]) > MADE:
            raise ValueError(f"{MADE} plots at most")
        return self._do(lambda: self._answer(at * 1_000_000, begin * 1_000_000, end * 1_000_000,
                                             min(parts["points"], MAX_POINTS), parts["sources"], number))

    def look(self) -> Future[None]:
        """Look for files."""
        return self._do(self._look)

    def _do(self, job: Callable[[], Answer]) -> Future[Answer]:
        def worked() -> Answer:
            if self._is_over.wait(max(0.0, self._rested_s - time.perf_counter())):
                raise RuntimeError("the web console ends")
            begin_s = time.thread_time()
            try:
                return job()
            finally:
                self._rested_s = time.perf_counter() + min(MAX_REST_S, REST * (time.thread_time() - begin_s))

        return self._work.submit(worked)

    def _opened(self) -> RecordedFiles:
        """Loads what reads recordings: most pages never need it."""
        from trocar.procs.gui.recorded import RecordedFiles

        if self._files is None:
            self._files = RecordedFiles(self._folder or Path("/nonexistent"), self._frozen,
                                        is_simulated=self._document.clock != WALL)
        return self._files

    def _look(self) -> None:
        if self._folder is not None:
            self.begin_ns = min((names.time_in(file.path.name) for file in kept(self._folder, names.BOX)), default=0)
            self.faults = self._opened().faults() if kept(self._folder, names.FAULT) else ()

    def _answer(self, at_ns: int, begin_ns: int, end_ns: int, points: int, sources: Sequence[str], number: Any
                ) -> bytes:
        files, times = self._opened(), times_of(self._document)
        end_ns = min(end_ns, local_ns())
        state = PastRings(files, times, at_ns - BEFORE_NS, at_ns, is_state=True)
        samples = PastRings(files, times, begin_ns, end_ns, is_state=False)
        data = {}
        states, traces = makers_of(self._document, state), makers_of(self._document, samples)
        families = families_of(self._document, samples)
        for name in sources:
            family, _, rest = name.partition(":")
            try:
                if family in families:
                    data[name] = _thinned(families[family](rest)().read(end_ns), points)
                elif "/trace" in name and name in traces:
                    data[name] = _thinned(traces[name]().read(end_ns), points)
                elif name in states:
                    with closing(states[name]()) as source:
                        data[name] = source.read(at_ns)
                else:
                    data[name] = {"age": None, "problem": NOT_RECORDED}
            except (SegmentError, OSError, ValueError, KeyError) as error:
                data[name] = {"age": None, "problem": str(error)}
        return orjson.dumps({"op": "past", "id": number, "at": at_ns // 1_000_000, "data": data,
                             "known": state.is_known or samples.is_known}, option=OPTIONS)

    def close(self) -> None:
        """End the thread, close all files."""
        self._is_over.set()
        self._work.shutdown(cancel_futures=True)
        if self._files is not None:
            self._files.close()


def times_of(document: SystemConfig) -> Times:
    """Of the present run: as the recorder notes them once a second, and now."""
    now_ns = local_ns()
    stamps, local = [np.array([now_ns - local_offset_ns(document.name)])], [np.array([now_ns])]
    if document.clock != WALL:
        with suppress(SegmentError), closing(directory.reader(document.name, RECORDER, "state", often=False)) as reader:
            rows = reader.last(reader.depth)
            stamps, local = [rows["system_ns"], *stamps], [rows["local_ns"], *local]
    return Times(np.concatenate(stamps), np.concatenate(local))


def _thinned(found: dict[str, Any], points: int) -> dict[str, Any]:
    """At most about `points` samples: of each interval the least and the greatest, so that no peak is lost."""
    if len(found.get("t", ())) <= points:
        return found
    many = isinstance(found["v"], list)
    columns = [np.asarray(column, float) for column in (found["v"] if many else [found["v"]])]
    times = np.asarray(found["t"])
    each = -(-2 * len(times) // points)
    count = len(times) // each
    cut = count * each
    first = columns[0][:cut].reshape(count, each)
    filled = np.nan_to_num(first)
    places = np.stack([filled.argmin(1), filled.argmax(1)], 1) + np.arange(count)[:, None] * each
    chosen = np.unique(np.append(places, np.arange(cut, len(times))))
    thin = [column[chosen] for column in columns]
    return found | {"t": times[chosen], "v": thin if many else thin[0]}
