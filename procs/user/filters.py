"""Users' filters that share a process, which calls each once a period, in the order of the system file.

An error in a filter affects only that filter, which is restarted like a process.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from typing import Final

from trocar.procs.document.process import Process
from trocar.procs.node.life import TimeUp, cause_of, document_of, limited
from trocar.procs.node.node import Node
from trocar.procs.tables import codes
from trocar.procs.user.process import UserLoop, class_in
from trocar.shm.mailbox.origins import ACTING, NO_ORIGIN
from trocar.shm.memory.layout import shorten
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage

HEALTHY_NS: Final = 10_000_000_000
WARN_EVERY_NS: Final = 60_000_000_000


def filter_in(module: str) -> type[UserLoop]:
    """The class of a filter in its module; ImportError when there is not exactly one, or it has a `main`."""
    found = class_in(module)
    if found.main is not UserLoop.main:
        raise ImportError(f"{module}: {found.__name__} has a main; what shares a process has an update")
    return found


class HostedFilter:
    """One filter in the shared process, and its object while it runs."""

    def __init__(self, system: str, row: Process, find: Callable[[], type[UserLoop]], most_s: float) -> None:
        """`find` gives its class; a setup or update that takes longer than `most_s` is an error."""
        self._system, self._row, self._find, self._most_s = system, row, find, most_s
        self._log = logging.getLogger(row.name)
        self._process: UserLoop | None = None
        self._begin_ns: int | None = 0  # time of the next start; None: no more starts
        self._begun_ns = self._failures = self._warn_ns = 0
        self._why = ""  # its last failure, shown on its page until it has run without error for HEALTHY_NS

    def cycle(self) -> None:
        """Call the filter once, or start it when due."""
        now = monotonic_ns()
        if self._process is not None:
            self._guarded(self._process.step)
            self._look_at_time(monotonic_ns() - now)
            self._show_failures(now)
        elif self._begin_ns is not None and now >= self._begin_ns:
            self._begun_ns, ACTING.origin = now, NO_ORIGIN
            self._guarded(self._make)

    def _make(self) -> None:
        kind, node = self._find(), Node(document_of(self._system), self._row.name)
        try:
            self._process = kind(node)
        except BaseException:
            node.close()
            raise
        self._process.begin()
        self._show_failures(self._begun_ns)

    def _show_failures(self, now: int) -> None:
        """Show number and cause of failures until it has run well for HEALTHY_NS; its own error text has priority."""
        process = self._process
        if process is None or not self._failures:
            return
        if now - self._begun_ns > HEALTHY_NS:
            self._failures = 0
            if process.error == self._why:
                process.error = ""
        elif not process.error:
            process.node.page.field("error")[...] = self._why.encode()

    def _guarded(self, do: Callable[[], None]) -> None:
        try:
            limited(self._most_s, do)
        except (Exception, SystemExit, TimeUp) as error:
            self._log.exception("ended by an error")
            self._end(cause_of(error))

    def _look_at_time(self, took_ns: int) -> None:
        process, now = self._process, monotonic_ns()
        if process is not None and took_ns > self._row.period_s * 1e9 and now >= self._warn_ns:
            self._warn_ns = now + WARN_EVERY_NS
            process.node.events.report(codes.USER_SLOW, f"{self._row.name} took {took_ns * 1e-6:.1f} ms of a period of "
                                      f"{self._row.period_s * 1e3:g} ms; all filters of its process wait meanwhile",
                                      self._row.name)

    def _end(self, why: str) -> None:
        """Show why it failed, and plan its restart."""
        now = monotonic_ns()
        self._failures += 1
        count = "once" if self._failures == 1 else f"{self._failures} times in a row"
        self._why = shorten(f"it has failed {count}: {why}", 399).decode(errors="ignore")
        if self._row.on_exit != "restart" or self._failures > self._row.restart_limit:
            self._begin_ns = None
            why += "; not started again" if self._row.on_exit != "restart" else "; given up"
        else:
            self._begin_ns = now + round(self._row.backoff_s * 2 ** (self._failures - 1) * 1e9)
        if self._process is not None:
            self._process.node.events.report(codes.USER_ERROR, why, self._row.name)
        self._close("FAILED", why)

    def stop(self) -> None:
        """Stop the filter as its process ends."""
        if self._process is not None:
            self._close("STOPPED", "its process ends")

    def _close(self, state: str, why: str) -> None:
        process, self._process = self._process, None
        if process is not None:
            try:
                limited(self._most_s, process.quit)
            except (Exception, SystemExit, TimeUp):
                self._log.exception("its quit ended by an error")
            process.node.close()
        with contextlib.closing(ControlPage(self._system, self._row.name, write=True)) as page:
            page.show(state, why)
