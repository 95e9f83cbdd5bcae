"""Environment of the stages: the robots, the person, and a running system to observe and command."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import Cart
from trocar.procs.document.system import SystemConfig
from trocar.procs.tables.bring_up import DISABLED, ENABLED
from trocar.shm.commands import ENDINGS
from trocar.shm.memory.closable import Closable
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.bring_up import bring_all
from trocar.tools.client.remote import Remote
from trocar.tools.commission.person import Person
from trocar.tools.commission.subject import SETUP_JOINTS, Subject, carts_of, setup_subject, subjects_of
from trocar.tools.commission.window import Window
from trocar.tools.output.errors import Problem

SLICE_S: Final = 0.5  # the ring keeps 3 s
OFF_S: Final = 0.2  # amplifiers are off long before


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """Outcome of a command: done, refused or failed, and the reason."""

    outcome: str
    text: str

    @property
    def is_done(self) -> bool:
        """Whether it was carried out."""
        return self.outcome == "done"


@dataclass(frozen=True, slots=True)
class SetupReadings:
    """Potentiometers of a cart's setup arms: whole `rounds` so far, `clutched` (n,), `volts` (n, 2, 6)."""

    rounds: int
    clutched: NDArray[np.bool_]
    volts: NDArray[np.float64]

    @classmethod
    def of(cls, field: Callable[[str], NDArray[Any]]) -> SetupReadings:
        """From fields of the record of setup joints."""
        volts = np.stack([field("primary_voltage"), field("secondary_voltage")], axis=1)[:, :, :SETUP_JOINTS]
        return cls(int(field("rounds")), field("clutched").copy(), volts.astype(np.float64))


class RunningBench(Closable):
    """A running system; a context manager."""

    def __init__(self, document: SystemConfig, person: Person, chosen: list[str] | None = None) -> None:
        """Attach; SegmentError when it does not run."""
        self.document, self.person = document, person
        self.system = document.name
        self.subjects, self.carts = subjects_of(document, chosen), carts_of(document, chosen)
        self.setups = tuple(setup_subject(document, cart) for cart in self.carts)
        self._open = contextlib.ExitStack()
        self.time = self._open.enter_context(SystemTime(self.system))
        """The time in which stages measure and wait; a rehearsal's may be simulated."""
        self._readers: dict[str, RingReader] = {}
        self._remotes: dict[str, Remote] = {}
        self._whole = self._open.enter_context(Remote(self.system, "system"))
        self._setups: dict[str, RingReader] = {}
        for cart in self.carts:
            self._setups[cart.name] = setup = directory.reader(self.system, cart.name, "state", "suj", often=False)
            self._open.callback(setup.close)
        for io in {subject.io for subject in self.subjects} | {cart.io for cart in self.carts}:
            self._readers[io] = reader = directory.reader(self.system, io, "state", "io")
            self._open.callback(reader.close)
            self._remotes[io] = self._open.enter_context(Remote(self.system, io))

    def sample(self, io: str, seconds: float) -> Window:
        """Records of one io for this time from now on; Problem if there are none."""
        since = self.time.now_ns()
        end, parts = since + round(seconds * 1e9), []
        while self.time.now_ns() < end:
            self.time.pause(min(SLICE_S, max(0.001, (end - self.time.now_ns()) * 1e-9)))
            parts.append(self._since(io, since))
            since = round(parts[-1].stamp_s[-1] * 1e9) + 1 if len(parts[-1]) else since
        window = Window.joined(parts)
        if not len(window):
            raise Problem(f"{io} has shown nothing for {seconds:g} s; does it run? (trocar status)")
        return window

    def _since(self, io: str, stamp_ns: int) -> Window:
        return Window.of_rows(self._readers[io].since(stamp_ns))

    def asked(self, io: str, command: str, values: tuple[float, ...], text: str, timeout: float) -> \
            tuple[CommandOutcome, Window]:
        """Send a command to an io; returns its records until the final answer."""
        remote, since, parts = self._remotes[io], self.time.now_ns(), []
        number, end = remote.send(command, np.array(values), text), since + round(timeout * 1e9)
        while True:
            ended = [reply for reply in remote.replies_to(number) if reply.outcome in ENDINGS]
            self.time.pause(0.02)
            parts.append(self._since(io, since))
            since = round(parts[-1].stamp_s[-1] * 1e9) + 1 if len(parts[-1]) else since
            if ended:
                return CommandOutcome(ended[-1].outcome, ended[-1].text), Window.joined(parts)
            if self.time.now_ns() >= end:
                return CommandOutcome("failed", f"no answer within {timeout:g} s"), Window.joined(parts)

    def enable(self, subject: Subject) -> None:
        """Power and amplifiers of an arm, or of setup joints, on, without commands; Problem if they do not come on."""
        bring_all(self.system, [subject.arm], ENABLED)

    def disable(self, subject: Subject) -> None:
        """Switch everything off. What its process answers is secondary: io gets the command, too.

        Problem if amplifiers are still on.
        """
        with contextlib.suppress(Problem):
            bring_all(self.system, [subject.arm], DISABLED)
        self.asked(subject.io, "power_off", (), subject.name, 2.0)
        window = self.sample(subject.io, OFF_S)
        if window.drives("amp_on", subject)[-1].any():
            raise Problem(f"{subject.whole()}: amplifiers are still on; press the emergency stop")

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.time.pause(seconds)

    @contextlib.contextmanager
    def showing(self, name: str, position: Sequence[float]) -> Iterator[None]:
        """Show a ghost of an arm (or SUJ/setup arm) with these joints (m, rad) in 3D; it ends with us in any case."""
        with contextlib.suppress(Problem):
            self._whole.ask("show_pose", position, name)
        try:
            yield
        finally:
            with contextlib.suppress(Problem):
                self._whole.ask("show_pose")

    def setup_readings(self, cart: Cart) -> SetupReadings:
        """The newest ones; Problem if there are none."""
        reader = self._setups[cart.name]
        if not reader.newest():
            raise Problem(f"{cart.name} shows nothing; does it run? (trocar status)")
        return SetupReadings.of(reader.field)

    def close(self) -> None:
        """Detach."""
        self._open.close()
