"""Long plays of two consoles that share arms: what they ask of whom in each step of them; see tests.traces."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest

from tests.arm.fake_requests import FakeRequest
from tests.guarded import objection
from tests.traces import Trace, shown
from trocar.procs.console.console_commands import ConsoleCommands
from trocar.procs.console.logic import CAMERA, CLUTCH, OPERATOR, Logic
from trocar.procs.console.selection import ECM, PSM, Selectable, conflicts
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.tables.code_row import Code
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin

FOLDER = Path(__file__).parent / "traces"
STEPS = 500
MS = 1_000_000
MEMBERS = (
    Selectable("MTML_MTMR_ECM", "c", ECM, ("MTML", "MTMR", "ECM")), Selectable("MTMR_PSM1", "c", PSM, ("MTMR", "PSM1")),
    Selectable("MTML_PSM2", "c", PSM, ("MTML", "PSM2")), Selectable("MTML_PSM3", "c", PSM, ("MTML", "PSM3")),
    Selectable("MTMX_MTMY_ECM", "d", ECM, ("MTMX", "MTMY", "ECM")), Selectable("MTMX_PSM1", "d", PSM, ("MTMX", "PSM1")),
    Selectable("MTMY_PSM4", "d", PSM, ("MTMY", "PSM4")),
)
NAMES = [member.name for member in MEMBERS]
ASKED = (
    *(("select_teleop", (), name) for name in (*NAMES, f" {NAMES[3]} ", "", "nobody")),
    *(("unselect_teleop", (), name) for name in (*NAMES, "nobody")),
    *(("teleop_enable", (value,), "") for value in (0.0, 1.0, 1.0, 1.0, 2.0)), ("teleop_enable", (), ""),
    *(("set_scale", (value,), "") for value in (0.3, 0.0, -1.0, math.inf, math.nan)), ("set_scale", (1.0, 2.0), ""),
    *((f"emulate_{name}", (value,), "") for name in ("operator_present", "clutch", "camera")
      for value in (0.0, 1.0, 2.0, 0.5)),
)


class LoggedDesk:
    """What a console says, to whom; those that are `deaf` cannot be told."""

    def __init__(self, name: str, log: list[str]) -> None:
        self.name, self.log, self.deaf = name, log, set[str]()

    def ask(self, teleop: str, command: str, values: Sequence[float] = (), text: str = "",
            origin: Origin = NO_ORIGIN) -> bool:
        reason = objection("teleop", command, values, text, origin)
        heard = " (not heard)" if teleop in self.deaf else f" ({reason})" if reason else ""
        self.log.append(f"{self.name} > {teleop} {command} {text}{shown(tuple(values))} for {origin.id}{heard}")
        return teleop not in self.deaf

    def free(self, teleop: str) -> None:
        self.log.append(f"{self.name} frees {teleop}")

    def emit(self, event: str, text: str = "", component: str = "", value: float = 0.0) -> None:
        self.log.append(f"{self.name}: {event} {text} {component} {value:g}")

    def button(self, name: str, kind: int) -> None:
        self.log.append(f"{self.name}: button {name} {kind}")

    def status(self, text: str) -> None:
        self.log.append(f"{self.name}: {text}")

    def report(self, code: Code, text: str) -> None:
        self.log.append(f"{self.name}: {code.code}: {text}")

    def beep(self, duration_s: float, frequency_hz: float) -> None:
        self.log.append(f"{self.name} beeps {duration_s:g} s {frequency_hz:g} Hz")


class ConsolesPlay:
    """Two consoles that see what the other has selected a step later."""

    def __init__(self, seed: str) -> None:
        self.chance, self.trace, self.now_ns, self.faults = Random(seed), Trace(), 1_000 * MS, 0
        self.log: list[str] = []
        self.desks = [LoggedDesk(name, self.log) for name in ("c", "d")]
        self.logics = [Logic(desk.name, MEMBERS, desk, 0.2) for desk in self.desks]
        self.commands = [ConsoleCommands(logic) for logic in self.logics]

    def happen(self, logic: Logic, desk: LoggedDesk) -> None:
        """Something may happen to a console."""
        chance, mine = self.chance, [member.name for member in logic.mine]
        name = chance.choice(mine)
        acts: list[Callable[[], object]] = [
            *((lambda button=button, kind=kind: logic.press(button, kind))  # type: ignore[misc]
              for button in (OPERATOR, CLUTCH, CAMERA) for kind in (PRESSED, RELEASED, CLICKED)),
            lambda: logic.enable(True, Origin(1 + len(self.trace.lines), self.faults, "play")),
            lambda: logic.lose_operator("its inputs are silent"),
            lambda: logic.began_anew(name), lambda: logic.refused(name, self.now_ns),
            lambda: logic.shows(name, "DISABLED"), lambda: logic.shows(name, "ENABLED"),
            lambda: desk.deaf.add(name), desk.deaf.clear, desk.deaf.clear,
            lambda: self.select_unseen(logic, name),
            lambda: logic.faults_until(self.faults), self.fault]
        if chance.random() < 0.35:
            chance.choice(acts)()

    def select_unseen(self, logic: Logic, name: str) -> None:
        """As if the other console had not shown yet what it has selected."""
        member = MEMBERS[NAMES.index(name)]
        if not any(other.name in logic.selected for other in conflicts(member, logic.mine)):
            logic.selected.add(name)

    def fault(self) -> None:
        self.faults += 1

    def step(self) -> None:
        self.now_ns += self.chance.choice((10, 10, 10, 100, 250, 500, 1000)) * MS
        selected = [set(logic.selected) for logic in self.logics]
        for number, (logic, desk) in enumerate(zip(self.logics, self.desks, strict=True)):
            logic.elsewhere = selected[1 - number]
            self.happen(logic, desk)
            requests = []
            if self.chance.random() < 0.2:
                name, values, text = self.chance.choice(ASKED)
                requests.append(FakeRequest(name, values, text))
            self.commands[number].execute(requests, self.now_ns)
            logic.step(self.now_ns)
            self.log += [f"{logic.name} < {r.name} {r.text}{shown(r.values)}: {r.replies}" for r in requests]
        self.trace.look(self.log, self.seen())
        self.log.clear()

    def seen(self) -> list[tuple[str, Any]]:
        return [(f"{logic.name}.{name}", sorted(value) if isinstance(value, set) else value)
                for logic in self.logics for name, value in (
                    *((name, getattr(logic, name)) for name in (
                        "selected", "lapsed", "fallen", "operator", "clutch", "camera", "wanted", "scale")),
                    ("asked", list(logic.asked.values())), ("origin", logic.origin.id))]


@pytest.mark.parametrize("seed", ["consoles", "consoles-again"])
def test_consoles_do_in_a_long_play_what_they_did(seed: str) -> None:
    play = ConsolesPlay(seed)
    for _ in range(STEPS):
        play.step()
        for logic in play.logics:
            assert logic.selected <= {member.name for member in logic.mine}
    play.trace.compare(FOLDER / f"{seed}.txt")


def test_two_consoles_that_see_each_other_never_run_what_shares_an_arm() -> None:
    play = ConsolesPlay("shared")
    arms = {member.name: (member.kind, set(member.arms)) for member in MEMBERS}
    for _ in range(STEPS):
        play.step()
        for _ in range(2):  # nothing happens: each has seen what the other has
            seen = [set(logic.selected) for logic in play.logics]
            for number, logic in enumerate(play.logics):
                logic.elsewhere = seen[1 - number]
                logic.step(play.now_ns)
        both = sorted(play.logics[0].selected | play.logics[1].selected)
        for one, other in ((a, b) for a in both for b in both if a < b):
            assert arms[one][0] != arms[other][0] or not arms[one][1] & arms[other][1], (one, other)
