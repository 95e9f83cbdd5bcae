"""A scene of the storm with a system of its own: a Classic patient cart, whose lift and setup clutches are used."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tests.soak import recorder
from tests.soak.diary import Diary
from tests.soak.judge import Intervention, LiftEnd, Violation, lifts_on
from tests.soak.person import TROUBLES, StormPerson
from tests.soak.powerless import powerless
from tests.soak.system import System, wait_for
from trocar.procs.machine.paths import ROOT
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.examples.operator_sim import SeenRecord

DATA = Path(os.environ.get("TROCAR_TEST_DATA", str(ROOT.parent / "shared" / "data")))
FILE, SHARE = DATA / "dvrk-site" / "jhu-daVinci" / "system-SUJ.json", DATA / "dvrk-share"
SUJ, ARM, BUTTON, DISABLE = "SUJ", "PSM1", "SUJ_clutch_2", "disable_PWM"
LIFT_S = 1.0  # that one command lasts
STRUCK_S, GONE_S = 0.4, 0.6  # io's 30 ms, and what a busy machine adds; a client that is gone is noticed later
PATIENCE_S = 30.0
OF_IO = ("IO1.state:io:output",)


class CartScene:
    """See Scene; nothing here is struck by the weather."""

    name, events, client_share = "cart", 6, 1.0
    victims: Sequence[str] = ()

    def __init__(self, system: System, diary: Diary, chance: random.Random) -> None:
        self._system, self._diary, self._chance = system, diary, chance
        self._person = StormPerson(system, diary)
        self._is_up = False
        self.wrong: list[str] = []  # after its end

    def keep(self) -> str:
        """See Scene."""
        if not self._is_up:
            self._system.start()
            self._is_up = True
        wait_for(lambda: not self._system.look(), PATIENCE_S)
        if self._state() != "ENABLED":
            for word in ("disable", "enable"):
                self._person.report(SUJ, "state_command", text=word)
        return "" if wait_for(lambda: self._state() == "ENABLED", PATIENCE_S) else f"{SUJ} is {self._state()}"

    def _state(self) -> str:
        try:
            seen = SeenRecord(self._system.name, SUJ, "suj")
            state = str(seen.value("state")) if not seen.value("is_busy") else ""
            seen.ring.close()
        except TROUBLES as problem:
            return str(problem)
        return state

    def client_events(self) -> Mapping[str, Callable[[], str]]:
        """See Scene."""
        return {"lift_kill": lambda: self._struck(signal.SIGKILL), "lift_pause": lambda: self._struck(signal.SIGSTOP),
                "lift_client_kill": self._client, "setup_clutch": self._clutch,
                "powerless_clutch": lambda: powerless(self._system, self._diary, (SUJ, "clutch", (1.0,), ARM))}

    def _begin(self, words: str) -> None:
        self._diary.note("event", words)
        self._diary.lifts.append(Intervention("lift", monotonic_ns(), words))

    def _end(self, in_s: float, words: str) -> None:
        self._diary.lift_ends.append(LiftEnd(monotonic_ns(), in_s, words))

    def _strike(self, number: signal.Signals) -> str:
        self._system.signal(SUJ, number)
        if number == signal.SIGKILL:
            return f"kill -9 {SUJ}"
        length_s = self._chance.uniform(0.06, 0.5)
        pause(length_s)
        self._system.signal(SUJ, signal.SIGCONT)
        return f"SIGSTOP {SUJ} {length_s * 1e3:.0f} ms"

    def _struck(self, number: signal.Signals) -> str:
        """The process that lifts is killed or stalled in the middle of it."""
        self._begin("the cart lifts")
        refused = self._person.report(SUJ, "set_lift_velocity", (self._chance.choice((1.0, -1.0)),))
        pause(self._chance.uniform(0.05, 0.6))
        self._end(STRUCK_S, f"signal {number.name} to {SUJ}, which lifts")
        words = f"{self._strike(number)} while it lifts"
        pause(LIFT_S)
        return f"{words} ({refused})" if refused else words

    def _client(self) -> str:
        """The client that lifts is killed."""
        self._begin("a client lifts the cart")
        words = [sys.executable, "-m", "tests.soak.puppets", "lift", self._system.name, SUJ, "0"]
        puppet = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert puppet.stdout is not None
        puppet.stdout.readline()
        pause(self._chance.uniform(0.3, 1.5))
        puppet.kill()
        puppet.wait()
        self._end(LIFT_S + GONE_S, "the death of the client that lifts")
        pause(LIFT_S + GONE_S)
        return "kill -9 the client that lifts the cart"

    def _clutch(self) -> str:
        """Somebody moves a setup arm, and its process is struck."""
        words = f"setup clutch of {ARM}"
        self._diary.note("event", words)
        self._person.report("boards", "press", (1.0,), BUTTON)
        pause(self._chance.uniform(0.1, 1.0))
        struck = self._strike(self._chance.choice((signal.SIGKILL, signal.SIGSTOP)))
        pause(self._chance.uniform(0.1, 1.0))
        self._person.report("boards", "press", (0.0,), BUTTON)
        return f"{words}, {struck}"

    def end(self) -> None:
        """See Scene."""
        if self._is_up:
            self._is_up = False
            self.wrong += self._system.stop()
            self._system.clean()

    def judge(self) -> list[Violation]:
        """The lift, by all that was recorded."""
        found: list[Violation] = []
        for path in self._system.records:
            io = recorder.beside(path, "IO1.state")
            truth, _ = recorder.read(io)
            pin = recorder.info(io)["outputs"].index(DISABLE)
            found += lifts_on(truth["stamp_ns"], ~truth["output"][:, pin], self._diary.lifts, self._diary.lift_ends)
        return found
