"""Identification of the instrument on a PSM: by its file (FIXED), the operator (MANUAL), or its memory (AUTOMATIC).

If the memory cannot be read, or its content is unknown, the operator is asked as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from trocar.procs.arm.context import ToolReading
from trocar.procs.arm.control import Control
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.document.catalogue import CatalogueMatch, find, full_name
from trocar.procs.document.system import Tool
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables import codes

RETRY_NS: Final = 500_000_000
MAX_NS: Final = 6_000_000_000  # io gives up a reading after 3 s, and may have one for another arm in progress


class Detection:
    """Identifies the instrument; call `step` while one is present and `tool` is None."""

    def __init__(self, control: Control, reading: Callable[[], ToolReading]) -> None:
        arm = control.arm
        self._control, self._reading = control, reading
        self._is_fixed, self._fixed = arm.tool_detection == "FIXED", arm.tool
        self._reads = arm.tool_detection == "AUTOMATIC" and bool(arm.instrument_reader)
        self.tool: Tool | None = None
        self.joints: JointSpace | None = None
        """The arm's joint space with this instrument."""
        self.asks = False
        """The operator is asked for the type."""
        self._asked_ns = self._due_ns = self._heard_ns = self._order = 0
        if self._is_fixed and arm.tool is not None:
            self.take(arm.tool)

    def forget(self) -> None:
        """The instrument was removed or replaced."""
        self.asks = False
        self._asked_ns = self._order = 0
        self.tool = self.joints = None

    def take(self, tool: Tool) -> None:
        """Set the instrument; ValueError if the arm cannot be driven with it."""
        self.joints = joints(self._control.arm, tool)
        self.tool = self._fixed = tool
        self.asks = False

    def named(self, name: str) -> None:
        """The operator names the instrument; CommandRefused if there is none of this name."""
        try:
            self._take_named(name)
        except ValueError as error:
            raise CommandRefused(str(error)) from None

    def _take_named(self, name: str) -> None:
        arm = self._control.arm
        known = arm.tools + ((arm.tool,) if arm.tool is not None and arm.tool not in arm.tools else ())
        found: CatalogueMatch[Tool] = find(name, known)
        if found.entry is None:
            raise ValueError(f"{name[:40] or 'no name'}: {found.reason}; there are: "
                             f"{', '.join(found.candidates or map(full_name, known))}")
        self._name(found.entry)

    def _name(self, tool: Tool) -> None:
        control = self._control
        self.take(tool)
        control.reports.emit("tool_type", full_name(tool))
        needs = tool.needs_depth(control.arm.generation)
        if needs and not control.arm.cannula_depth and not control.is_kinematic:
            control.status(f"{full_name(tool)}: {needs}")

    def step(self) -> None:
        """Identify the attached instrument."""
        if self._is_fixed and self._fixed is not None:
            self._name(self._fixed)
        elif not self._reads:
            self._ask()
        else:
            self._read()

    def _read(self) -> None:
        reading = self._reading()
        news = reading.status in ("READ", "ABSENT", "ERROR") and reading.since_ns != self._heard_ns
        if news and 0 < self._asked_ns <= reading.since_ns:
            self._heard_ns = reading.since_ns
            self._hear(reading)
        elif not self.asks:  # else a reading requested by another program may still identify it
            self._have_it_read()

    def _hear(self, reading: ToolReading) -> None:
        try:
            if reading.status != "READ":
                raise ValueError(f"its memory could not be read ({reading.status})")
            self._take_named(reading.tool)
        except ValueError as error:
            self._fail(str(error))

    def _have_it_read(self) -> None:
        control = self._control
        now = control.now_ns
        if not self._asked_ns:
            self._asked_ns, self._due_ns = now, now
        if self._order:
            answer = control.io_requests.outcome(self._order)
            if answer is not None and answer.outcome == "refused":
                self._order, self._due_ns = 0, now + RETRY_NS
        elif now >= self._due_ns:
            self._order = control.io_requests.order("trigger_read", (), control.arm.instrument_reader)
        if now - self._asked_ns > MAX_NS:
            self._fail("io did not read its memory")

    def _fail(self, reason: str) -> None:
        self._order = 0
        self._control.reports.emit("tool_type", "ERROR")
        self._control.report(codes.TOOL_UNKNOWN, f"instrument not known: {reason}")
        self._ask()

    @property
    def request(self) -> str:
        """The request to the operator."""
        arm = self._control.arm
        return f"instrument not named (tool_detection {arm.tool_detection}): trocar send {arm.name} set_tool_type NAME"

    def _ask(self) -> None:
        if not self.asks:
            self.asks = True
            self._control.reports.emit("tool_type_request")
            self._control.report(codes.TOOL_NOT_NAMED, self.request)
