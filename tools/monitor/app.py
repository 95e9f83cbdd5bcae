"""The screen of `trocar attach`: header and footer of the pages, keys, and the schedule for reading pages."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any, ClassVar

from rich.text import Text
from textual import events, on
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.widgets import ContentSwitcher, DataTable, Footer, Static

from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingError
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.tools.inspect.messages import time_of_day
from trocar.tools.monitor.overview import Overview, identity_of, overview
from trocar.tools.monitor.pages.lists import ArmsPage, CommandsPage, EventsPage, ProcessesPage, TopicChosen, TopicsPage
from trocar.tools.monitor.pages.page import InspectorPage, palette
from trocar.tools.monitor.pages.values import ValuesPage
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import printable, span

PAGES: tuple[type[InspectorPage], ...] = (ProcessesPage, TopicsPage, ValuesPage, EventsPage, ArmsPage, CommandsPage)
TICK_S = 0.1
HEAD_S = 1.0
"""Interval for reading the header."""
RESUMED_S = 0.3
"""Time after a pause (Ctrl-Z) when the terminal is ours again, and empty."""
WRONG = (SegmentError, RingError, Problem, OSError, ValueError)
"""Possible exceptions if a system goes down during a look, or has invalid content."""


@dataclass(frozen=True, slots=True)
class _Read:
    """Result of one look; `problem`: why the page could not be read."""

    seen: Overview
    page: Any
    problem: str


class InspectorApp(App[None]):
    """The full-screen monitor of one system, until the person quits."""

    CSS = """
    Screen { layout: vertical; }
    #head { height: auto; max-height: 8; padding: 0 1; }
    #titles, #remark { height: auto; max-height: 3; padding: 0 1; text-wrap: nowrap; text-overflow: ellipsis; }
    #titles { background: $panel; }
    ContentSwitcher { height: 1fr; }
    InspectorPage { height: 1fr; }
    LiveTable { height: 1fr; padding: 0 1; background: $background; }
    LiveTable > .datatable--header { text-style: bold; background: $background; color: $text; }
    LiveTable > .datatable--cursor { background: $primary 30%; color: $text; text-style: none; }
    .details { height: auto; padding: 0 1; color: $text-muted; border-top: solid $panel; }
    """
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[Any]] = [
        # Before the focused widget, so that keys count in the order in which they are pressed.
        *(Binding(str(k), f"page({k})", "page", show=k == 1, key_display=f"1-{len(PAGES)}", priority=True)
          for k, page in enumerate(PAGES, 1)),
        Binding("tab,right", "turn(1)", "page", show=False, priority=True),
        Binding("shift+tab,left", "turn(-1)", "page before", show=False, priority=True),
        Binding("slash", "search", "search", key_display="/", priority=True),
        Binding("escape", "forget", show=False, priority=True),
        Binding("f,space", "freeze", "freeze", key_display="f", priority=True),
        Binding("d", "theme", "dark", priority=True), Binding("ctrl+l", "redraw", show=False, priority=True),
        Binding("ctrl+z", "suspend_process", show=False, priority=True),
        Binding("q", "quit", "quit", priority=True), Binding("ctrl+c", "quit", show=False, priority=True),
    ]

    def __init__(self, system: str) -> None:
        super().__init__()
        self.system, self.frozen_ns = system, 0
        self._pages: list[InspectorPage] = [page(page.TITLE) for page in PAGES]
        self._identity: tuple[int, ...] = ()
        self._seen: Overview | None = None
        self._head_ns = self._page_ns = 0
        self._at = 0
        self._is_busy = self._is_typing = False
        self._problem = ""

    def compose(self) -> ComposeResult:
        """From top to bottom."""
        yield Static("", id="head", markup=False)
        yield Static("", id="titles", markup=False)
        yield Static("", id="remark", markup=False)
        with ContentSwitcher(initial=PAGES[0].TITLE):
            yield from self._pages
        yield Footer(show_command_palette=False)

    async def on_mount(self) -> None:
        """Look at once, then periodically."""
        self.page.table.focus()
        self.app_resume_signal.subscribe(self, lambda _: self.set_timer(RESUMED_S, self.action_redraw))
        await self._tick()
        self.set_interval(TICK_S, self._tick)

    def on_unmount(self) -> None:
        """Unmap."""
        for page in self._pages:
            page.close()

    @property
    def page(self) -> InspectorPage:
        """The one that is shown."""
        return self._pages[self._at]

    # looking

    async def _tick(self) -> None:
        now_ns, page = monotonic_ns(), self.page
        if self._is_busy or self.frozen_ns:
            self._show_head()
            return
        every_ns = round(page.EVERY_S * 1e9)
        is_due = now_ns >= self._page_ns + every_ns
        head_due = now_ns >= self._head_ns + min(round(HEAD_S * 1e9), max(every_ns, 500_000_000))
        if not (is_due or head_due):
            return
        self._is_busy = True
        try:
            found = await asyncio.to_thread(self._read, page, head_due)
        finally:
            self._is_busy = False
        if self.frozen_ns or not self.is_running:
            return
        if head_due:
            self._head_ns = now_ns
        self._seen = found.seen
        if page is self.page:  # else the person has changed the page meanwhile, which is still to be read
            self._page_ns, self._problem = now_ns, found.problem
            if found.page is not None:
                page.show(found.page)
            else:  # its data is of another time, or of another topic
                page.clear()
        self._show_head()

    def _read(self, page: InspectorPage, head_due: bool) -> _Read:
        """One look, beside the screen's own thread, and never two at a time."""
        seen, problem, found = self._seen, "", None
        try:
            if head_due or seen is None:
                seen = overview(self.system)
            if (identity := identity_of(self.system)) != self._identity:
                self._reattach(identity)
            if identity:
                found = page.read(seen)
        except WRONG as error:
            problem = str(error) or type(error).__name__
        return _Read(seen or Overview(self.system, "gone", None, ""), found, problem)

    def _reattach(self, identity: tuple[int, ...]) -> None:
        """To the memory that there is now: another system of the same name was started, or none is any more."""
        for page in self._pages:
            page.close()
        self._identity = ()
        if identity:
            for page in self._pages:
                page.open(self.system)
            self.query_one(ValuesPage).choose_from(self.query_one(TopicsPage).entries)
        self._identity = identity

    # -- header --

    def _show_head(self) -> None:
        seen = self._seen
        if seen is None:
            return
        colours = palette(self.current_theme.dark)
        head = Text()
        head.append(f"system {seen.system}", "bold")
        if self.frozen_ns:
            ago = (monotonic_ns() - self.frozen_ns) * 1e-9
            at = time_of_day(local_ns() - round(ago * 1e9)).partition(".")[0]
            head.append(f"  FROZEN at {at}, {span(ago)} ago (f: resume)", f"bold {colours.warning}")
        head.append(f"  {seen.words}", colours.good if seen.lives and seen.stalled_s is None else (
            f"bold {colours.bad}"))
        head.append(f"  clock {seen.clock}" if seen.lives else "")
        if seen.remark:
            head.append(f"\n{seen.remark}", f"bold {colours.warning}")
        head.append("\n" + seen.first, colours.good if seen.is_well else colours.warning)
        if self._problem:
            head.append(f"\n{self._problem}", colours.bad)
        self._update("#head", head)
        self._update("#titles", self._titles())
        self._update("#remark", self._remark())

    def _titles(self) -> Text:
        line = Text(no_wrap=True, overflow="ellipsis")
        for k, page in enumerate(PAGES):
            line.append(f"{k + 1} {page.TITLE}", "bold reverse" if k == self._at else "")
            line.append("  ")
        return line

    def _remark(self) -> Text:
        words = f'  with "{self.page.words}" (Esc: all)' if self.page.words else ""
        if self._is_typing:
            words = f"  search: {self.page.words}▏ (Enter keeps it, Esc: all)"
        return Text(f"{self.page.remark}{words}", palette(self.current_theme.dark).accent, no_wrap=True,
                    overflow="ellipsis")

    def _update(self, where: str, text: Text) -> None:
        """Only on a change: nothing is redrawn without need."""
        text.plain = printable(text.plain)
        widget = self.query_one(where, Static)
        if getattr(widget, "shown_text", None) != (shown := (text.plain, str(text.spans))):
            widget.update(text)
            widget.shown_text = shown  # type: ignore[attr-defined]

    # keys

    def action_page(self, number: int) -> None:
        """This one."""
        self._at = number - 1
        self.query_one(ContentSwitcher).current = PAGES[self._at].TITLE
        self.page.table.focus()
        self._page_ns = 0
        self._show_head()

    def action_turn(self, by: int) -> None:
        """The next page, or the one before."""
        self.action_page((self._at + by) % len(PAGES) + 1)

    async def on_event(self, event: events.Event) -> None:
        """Handle events as usual, except keys typed behind `/`."""
        if self._is_typing and isinstance(event, events.Key | events.Paste) and not event.is_forwarded:
            if isinstance(event, events.Paste):
                self._search_for(self.page.words + event.text.partition("\n")[0])
            else:
                self._typed(event)
        else:
            await super().on_event(event)

    def _typed(self, event: events.Key) -> None:
        if event.key in ("enter", "escape", "tab", "ctrl+c", "down", "up"):
            self._is_typing = False
            self._search_for("" if event.key in ("escape", "ctrl+c") else self.page.words)
        elif event.key == "backspace":
            self._search_for(self.page.words[:-1])
        elif event.character is not None and event.is_printable:
            self._search_for(self.page.words + event.character)

    def _search_for(self, words: str) -> None:
        self.page.search_for(words)
        self._show_head()

    def action_search(self) -> None:
        """Characters typed from now on are searched for on this page."""
        self._is_typing = True
        self._show_head()

    def action_forget(self) -> None:
        """End the search: show all rows again."""
        self._search_for("")

    def action_freeze(self) -> None:
        """Freeze the display, with a notice, until the key is pressed again."""
        self.frozen_ns = 0 if self.frozen_ns else monotonic_ns()
        self._page_ns = self._head_ns = 0
        self._show_head()

    def action_redraw(self) -> None:
        """Redraw everything, whatever other programs have written over it."""
        for widget in self.screen.walk_children(with_self=True):
            widget.refresh()

    def action_theme(self) -> None:
        """Dark on light, or light on dark."""
        self.theme = "textual-light" if self.current_theme.dark else "textual-dark"
        self.page.again()
        self._show_head()

    @on(TopicChosen)
    def _topic_chosen(self, event: TopicChosen) -> None:
        if event.topic:
            self.query_one(ValuesPage).choose(event.topic)
            self.action_page([page.TITLE for page in PAGES].index(ValuesPage.TITLE) + 1)

    @on(DataTable.RowHighlighted)
    def _moved(self) -> None:
        self.page.show_details()

    def on_resize(self) -> None:
        """Columns for the width there is now."""
        self.call_after_refresh(self.page.again)
