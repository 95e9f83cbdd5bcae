"""A bench without processes: io's core and emulated boards on a stepped clock, and a person played on them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tests.io.boards_harness import BoardsHarness
from tests.io.harness import FakeCommand
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.tools.commission.bench import CommandOutcome
from trocar.tools.commission.person_sim import PersonSim
from trocar.tools.commission.subject import Subject, carts_of, setup_subject, subjects_of
from trocar.tools.commission.window import FIELDS, Window


class Hands(PersonSim):
    """The played person; `confirmed` notes what was confirmed, `answers` are given instead of yes."""

    def __init__(self, harness: BoardsHarness, faults: BoardFaults) -> None:
        self._rig, self._faults = harness, faults
        self.confirmed: list[str] = []
        self.says = True
        super().__init__(self._do, self._where)

    def confirm(self, danger: str, word: str) -> None:
        self.confirmed.append(word)

    def agrees(self, question: str) -> bool:
        return self.says

    def _do(self, command: str, values: Sequence[float], text: str) -> None:
        if command == "set_position":
            self._faults.place(text, np.array(values))
        elif command == "move_by_hand":
            self._faults.place(text, np.array(values), by_hand=True)
        elif command == "support":
            self._faults.support(text, bool(values[0]))
        elif command == "press":
            self._faults.press(text, bool(values[0]))
        elif command == "emergency_stop":
            self._faults.stop(bool(values[0]))
        else:
            raise AssertionError(command)

    def _where(self, subject: Subject) -> np.ndarray:
        return self._rig.plant.position[self._rig.plant.slices[subject.name]]


class RigBench:
    """One io of a system; `faults` is what breaks on it. Its periods are long: the stages judge tenths of a second."""

    def __init__(self, file: str | Path, sets: Sequence[str] = (), search: Sequence[Path] = ()) -> None:
        loaded = load_system(PROJECT_CONFIGS / "systems" / file, boards="emulated", search=search,
                             sets=["io.period_s=0.008", "emulation.period_s=0.004", *sets])
        assert loaded.system is not None, loaded.errors
        self.document = loaded.system
        name = loaded.system.ios[0].name if loaded.system.carts else ""  # with what setup joints add to it
        self.harness = BoardsHarness(loaded.system, name, driven=True)
        self.faults = BoardFaults(self.harness.world, self.harness.plant)
        self.subjects, self.carts = subjects_of(loaded.system), carts_of(loaded.system)
        self.setups = tuple(setup_subject(loaded.system, cart) for cart in self.carts)
        self.shown: list[tuple[str, list[float]]] = []
        """Poses that the web console shows meanwhile, since start."""
        self.person = Hands(self.harness, self.faults)
        self.harness.run(0.1)

    def sample(self, io: str, seconds: float) -> Window:
        return self._noted(round(seconds * 1e9 / self.harness.period_ns))

    def asked(self, io: str, command: str, values: tuple[float, ...], text: str, timeout: float) -> \
            tuple[CommandOutcome, Window]:
        asked = FakeCommand(command, text, *values)
        rows = [self._noted(1, asked)]
        left = round(timeout * 1e9 / self.harness.period_ns)
        while asked.outcome == "accepted" and left:
            rows.append(self._noted(1))
            left -= 1
        rows.append(self._noted(20))
        return CommandOutcome(*asked.answers[-1]), Window.joined(rows)

    def _noted(self, count: int, *commands: FakeCommand) -> Window:
        record, notes, stamps = self.harness.record, {name: [] for name in FIELDS}, []
        for k in range(count):
            self.harness.cycle(commands if k == 0 else ())
            stamps.append(self.harness.clock.ns * 1e-9)
            for name in FIELDS:
                notes[name].append(np.array(getattr(record, name)))
        return Window(np.array(stamps), {name: np.array(rows) for name, rows in notes.items()})

    @contextlib.contextmanager
    def showing(self, name: str, position: Sequence[float]) -> Iterator[None]:
        self.shown.append((name, list(position)))
        yield

    def enable(self, subject: Subject) -> None:
        assert self.harness.do("power_on", subject.name).outcome == "done", self.harness.errors()

    def disable(self, subject: Subject) -> None:
        self.harness.do("power_off", subject.name)
        self.harness.run(0.1)


