"""The past of a system: what pages showed, or would have shown, at a time; from its rings, and the recorder's files.

The same sources as for the present read the records up to that time. All this runs in a thread of its own, one request
after the other, for a quarter of a core at most.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
import orjson
from numpy.typing import NDArray

from trocar.procs.document.recorder import NAME as RECORDER
from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.gui.catalogue import families_of, makers_of
from trocar.procs.gui.rings import PastReader
from trocar.procs.gui.sources import MADE, OPTIONS, Source
from trocar.procs.gui.times import Times
from trocar.procs.recordings import names
from trocar.procs.recordings.facts import local_offset_ns
from trocar.procs.recordings.folder import kept
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns

if TYPE_CHECKING:
    from trocar.procs.gui.recorded import FaultFile, RecordedFiles

MAX_SPAN_MS: Final = 60_000
"""Of samples in one answer."""
MAX_POINTS: Final = 2000
BEFORE_NS: Final = 2_000_000_000
"""The state at a time is in the records up to so long before it; what is written on change only, in its ring."""
EVENTS_NS: Final = 20_000_000_000
"""The same for events whose ring does not go back as far."""
WORK_S: Final = 4.0
"""CPU time for which a request reads recordings."""
REST: Final = 3.0
"""Times the work of a request, until the next one begins; at most MAX_REST_S."""
MAX_REST_S: Final = 2.0
NOT_RECORDED: Final = "not recorded"
Answer = TypeVar("Answer")


class PastRings:
    """The rings of a system, each with its records from `begin_ns` up to `end_ns` (time of day)."""

    def __init__(self, files: RecordedFiles, times: Times, begin_ns: int, end_ns: int, check: Callable[[], None], *,
                 is_state: bool) -> None:
        """`times`: of this run; `is_state`: of periodic rings, only the last record is used; `check`: see `picked`."""
        self._files, self._times, self._is_state, self._check = files, times, is_state, check
        self._begin_ns, self._end_ns = begin_ns, end_ns
        self._rows: dict[tuple[str, str], NDArray[Any]] = {}
        self._wanted: dict[str, np.dtype[np.void]] = {}
        self._read: dict[str, NDArray[Any] | str | None] = {}
        self.is_known = False
        """Whether any periodic ring that was read has records of this time."""

    def __call__(self, system: str, instance: str, ring: str, kind: str | None = None) -> PastReader:
        """See Rings. Files are read at the first use of a record, for all rings opened until then."""
        topic = f"{instance}/{ring}"
        with closing(directory.reader(system, instance, ring, kind, often=False)) as reader:
            dtype, is_periodic = reader.dtype, bool(reader.info.get("rate_hz"))
            if (instance, ring) not in self._rows:
                self._rows[instance, ring] = self._in_ring(reader, topic, is_periodic)
        return PastReader(dtype, partial(self._joined, topic, self._rows[instance, ring], is_periodic))

    def _in_ring(self, reader: RingReader, topic: str, is_periodic: bool) -> NDArray[Any]:
        """What the ring still has; what it has lost, if anything, is wanted from files."""
        dtype = reader.dtype
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
        has_enough = len(rows) and (has_first or (self._is_state and not is_event(topic)))
        if oldest_ns > self._begin_ns and not has_enough:
            self._wanted[topic] = dtype
        return rows

    def _joined(self, topic: str, rows: NDArray[Any], is_periodic: bool) -> NDArray[Any]:
        if topic in self._wanted:
            earlier = self._recorded(topic)
            if earlier is not None:
                before = earlier["stamp_ns"] < (rows["stamp_ns"][0] if len(rows) else self._end_ns + 1)
                rows = np.concatenate([earlier[before], rows])
        self.is_known = self.is_known or (is_periodic and bool(len(rows)))
        return rows

    def _recorded(self, topic: str) -> NDArray[Any] | None:
        """One pass over the files has all that is wanted, or the reason why not."""
        if topic not in self._read:
            said = is_event(topic)
            wanted = {name: dtype for name, dtype in self._wanted.items()
                      if name not in self._read and is_event(name) == said}
            self._read |= dict.fromkeys(wanted)
            begin_ns = self._end_ns - EVENTS_NS if said and self._is_state else self._begin_ns
            try:
                self._read |= self._files.records(wanted, begin_ns, self._end_ns, self._check,
                                                  only_last=self._is_state and not said)
            except ValueError as error:
                self._read |= dict.fromkeys(wanted, str(error))
        found = self._read[topic]
        if not isinstance(found, str):
            return found
        raise ValueError(found)


def is_event(topic: str) -> bool:
    """Whether all its records are shown, not the last one."""
    return topic.endswith("/events")


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
        check = self._checker()
        state = PastRings(files, times, at_ns - BEFORE_NS, at_ns, check, is_state=True)
        samples = PastRings(files, times, begin_ns, end_ns, check, is_state=False)
        data: dict[str, Any] = {}
        states, traces = makers_of(self._document, state), makers_of(self._document, samples)
        families = families_of(self._document, samples)
        opened: list[tuple[str, Source, bool]] = []
        with ExitStack() as stack:
            def take(name: str, step: Callable[[], None]) -> None:
                try:
                    step()
                except (SegmentError, OSError, ValueError, KeyError) as error:
                    data[name] = {"age": None, "problem": str(error)}

            def begin(name: str) -> None:
                family, _, rest = name.partition(":")
                is_plot = family in families or ("/trace" in name and name in traces)
                makers = traces if is_plot else states
                make = families[family](rest) if family in families else makers.get(name)
                if make is None:
                    raise ValueError(NOT_RECORDED)
                opened.append((name, stack.enter_context(closing(make())), is_plot))

            def read(name: str, source: Source, is_plot: bool) -> None:
                data[name] = _thinned(source.read(end_ns), points) if is_plot else source.read(at_ns)

            for name in sources:  # all before any is read
                take(name, partial(begin, name))
            for row in sorted(opened, key=itemgetter(2)):  # states first: samples may take all the time
                take(row[0], partial(read, *row))
        return orjson.dumps({"op": "past", "id": number, "at": at_ns // 1_000_000, "data": data,
                             "known": state.is_known or samples.is_known}, option=OPTIONS)

    def _checker(self) -> Callable[[], None]:
        """Raises an error when a request that begins now has taken too long."""
        end_s = time.thread_time() + WORK_S

        def check() -> None:
            if self._is_over.is_set():
                raise ValueError("the web console ends")
            if time.thread_time() > end_s:
                raise ValueError("reading the recordings takes too long; choose a shorter time")

        return check

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
