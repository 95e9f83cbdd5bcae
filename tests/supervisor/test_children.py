"""The life of one instance, and what those who ask for it are told, on a counted clock."""

from __future__ import annotations

import dataclasses

import pytest

from tests.supervisor.played import Clock, PlayedProcess, PlayedRequest, played
from trocar.procs.document.process import ON_DEMAND
from trocar.procs.node.setup_error import STAYS, LastingError, SetupError, exit_code
from trocar.procs.supervisor.children import SETUP_S, TRACE_S, Child, Ending, waves
from trocar.procs.supervisor.requests import Requests
from trocar.procs.supervisor.run import by_state
from trocar.procs.supervisor.supervisor import BEAT_S
from trocar.procs.tables import lifecycle


class IoAndArm:
    """An io and an arm that needs it."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.io, self.io_process = played("IO1", "io", self.clock)
        self.arm, self.process = played("PSM1", "arm", self.clock, ("IO1",))
        self.requests = Requests([self.io, self.arm])

    def asked(self, name: str, text: str = "PSM1") -> PlayedRequest:
        """A command arrives."""
        request = PlayedRequest(name, text)
        self.requests.take(request)  # type: ignore[arg-type]  # what is not asked for is not played
        self.io.ensure()
        self.arm.ensure()
        return request

    def goes_on(self) -> None:
        """A beat: everybody gets time, the supervisor looks."""
        for child, process in ((self.io, self.io_process), (self.arm, self.process)):
            process.goes_on()
            child.look()
            child.ensure()
        self.requests.answer()


@pytest.fixture
def system() -> IoAndArm:
    """Both are up."""
    made = IoAndArm()
    made.io.start()
    made.arm.start()
    made.goes_on()
    made.goes_on()
    assert made.io.is_up and made.arm.is_up
    return made


def test_who_starts_waits_for_setup_and_is_told_its_number(system: IoAndArm) -> None:
    system.asked("stop")
    system.goes_on()
    started = system.asked("start")
    system.requests.answer()
    assert started.answers == [("accepted", "")], "setup is a barrier"
    system.goes_on()
    assert started.answers[1:] == [("done", "PSM1 runs (pid 102)")]
    assert system.process.notes == ["setup", "main", "quit", "setup", "main"]


def test_a_second_start_does_nothing_and_says_so(system: IoAndArm) -> None:
    assert system.asked("start").answers == [("done", "PSM1 runs already (pid 101)")]
    assert system.process.begun == 1


def test_the_starter_hears_the_failures_own_text(system: IoAndArm) -> None:
    system.asked("stop")
    system.goes_on()
    started = system.asked("start")
    system.process.ends(3, "ValueError: no such tool")
    system.goes_on()
    assert started.answers[1:] == [("failed", "PSM1: exit code 3: ValueError: no such tool; it is tried again")]


def test_who_starts_a_users_process_hears_that_it_ends_at_once_again() -> None:
    clock = Clock()
    child, process = played("exits", "user", clock)
    requests = Requests([child])
    for ends_after_s in 0.2, 1.0:
        started = PlayedRequest("start", "exits")
        requests.take(started)  # type: ignore[arg-type]
        child.ensure()
        process.goes_on()
        child.look()
        requests.answer()
        assert started.answers == [("accepted", "")]
        clock.passes(ends_after_s)
        if ends_after_s < 1.0:
            process.ends(0, "its main has returned")
        child.look()
        requests.answer()
        assert started.answers[1:] == ([("failed", "exits: exit code 0: its main has returned; it is tried again")]
                                       if ends_after_s < 1.0 else [("done", "exits runs (pid 102)")])


def test_who_has_ended_by_itself_is_shown_as_stopped_when_it_is_stopped(system: IoAndArm) -> None:
    system.process.ends(-9)
    system.arm.look()
    assert not system.process.shown_stopped
    system.asked("stop")
    assert system.process.shown_stopped and system.process.failure_is_past
    for _ in range(2):
        assert system.arm.reason == "stopped: it had ended before: killed by SIGKILL"
        system.asked("stop")


def test_what_cannot_even_begin_is_told_as_well(system: IoAndArm) -> None:
    system.asked("stop")
    system.goes_on()
    system.process.lacks_memory = True
    started = system.asked("start")
    system.goes_on()
    assert started.answers[1:] == [("failed", "PSM1: could not be started: no memory; it is tried again")]


def test_a_start_while_stopping_gives_a_new_process_after_the_old_one(system: IoAndArm) -> None:
    stopped, started = system.asked("stop"), system.asked("start")
    assert system.arm.state == lifecycle.RESTARTING and system.process.begun == 1
    system.goes_on()
    assert stopped.answers[-1] == ("done", "PSM1: stopped") and system.process.begun == 2
    system.goes_on()
    assert started.answers[-1] == ("done", "PSM1 runs (pid 102)")


def test_a_stop_while_restarting_leaves_nothing_and_the_starter_hears_it(system: IoAndArm) -> None:
    restarted = system.asked("restart")
    system.asked("stop")
    system.goes_on()
    assert system.arm.state == lifecycle.STOPPED and system.process.begun == 1
    assert restarted.answers[-1] == ("failed", "PSM1 was stopped before it was up")


def killed_after(system: IoAndArm, seconds: float) -> Ending | None:
    """It is traced first, and killed in less than 50 ms, with a beat of the supervisor's."""
    system.clock.passes(seconds)
    assert system.arm.look() is None and system.process.traced and system.process.runs
    system.clock.passes(0.05 - BEAT_S)
    return system.arm.look()


def test_who_does_not_end_in_time_is_killed_and_that_is_said(system: IoAndArm) -> None:
    system.process.hangs = True
    stopped = system.asked("stop")
    ending = killed_after(system, 3.1)
    system.requests.answer()
    assert ending is not None and ending.killed and ending.asked
    assert stopped.answers[-1] == ("done", "PSM1: stopped: did not end within 3 s, killed; "
                                   "where: wall.py line 12 in step, trocar logs PSM1")


def test_who_has_ended_while_we_were_held_up_has_ended_well(system: IoAndArm) -> None:
    system.asked("stop")
    system.process.goes_on()
    system.clock.passes(60.0)
    ending = system.arm.look()
    assert ending is not None and not ending.killed and ending.text == "stopped"


def test_who_does_not_get_through_setup_in_time_is_killed(system: IoAndArm) -> None:
    system.asked("restart")
    system.goes_on()
    system.process.ready, system.process.hangs = False, True
    system.arm.kill_at_ns = system.arm.begun_ns + round(SETUP_S * 1e9)
    ending = killed_after(system, SETUP_S + 0.1)
    assert ending is not None and ending.text.startswith("setup was not done within 60 s, killed") and not ending.asked


def test_a_users_process_writes_where_it_hangs_and_is_killed_when_it_cannot() -> None:
    clock = Clock()
    child, process = played("camera", "user", clock)
    for stopped in False, True:
        child.start()
        child.ensure()
        process.goes_on()
        process.stopped = stopped
        child.kill_hung(5.0)
        ending = child.look()
        clock.passes(TRACE_S)
        ending = ending or child.look()
        assert ending is not None and ending.text.startswith("hung for 5.0 s, killed")
        assert ("; where: wall.py line 12 in step, trocar logs camera" in ending.text) != stopped
        assert ("; it was stopped (SIGSTOP)" in ending.text) == stopped


def test_deaths_are_repeated_ever_later_until_nobody_tries_any_more(system: IoAndArm) -> None:
    waits = []
    while not system.arm.given_up:
        system.process.ends(4)
        system.arm.look()
        if system.arm.restart_at_ns:
            waits.append((system.arm.restart_at_ns - system.clock.now_ns) * 1e-9)
            assert system.arm.shown_reason == f"exit code 4: ; automatic restart {len(waits)} of 5"
            system.clock.passes(waits[-1])
            assert system.arm.ensure()
            system.process.goes_on()
    assert waits == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.2])
    assert system.arm.reason.endswith("given up after 5 restarts")
    system.asked("start")
    system.goes_on()
    assert system.arm.is_up and not system.arm.given_up
    assert system.arm.shown_reason == system.arm.reason == "exit code 4: ", "it is tried again"


def test_what_stays_until_a_person_changes_it_is_not_tried_again(system: IoAndArm) -> None:
    assert exit_code(LastingError("a package is missing"), 3) == STAYS and exit_code(SetupError("no cable"), 3) == 3
    system.process.ends(STAYS, "a package is missing: pip install it")
    system.arm.look()
    assert system.arm.given_up and not system.arm.restart_at_ns and "restarts" not in system.arm.reason
    system.asked("start")
    system.goes_on()
    assert system.arm.is_up, "a person has changed it"


def test_a_stop_ends_the_trying(system: IoAndArm) -> None:
    system.process.ends(4)
    system.arm.look()
    assert system.asked("stop").answers == [("done", "PSM1 is not started again")]
    system.clock.passes(60)
    system.goes_on()
    assert system.process.begun == 1
    assert system.asked("stop").answers == [("done", "PSM1 does not run")]


def test_nothing_starts_without_what_it_needs(system: IoAndArm) -> None:
    for name in ("IO1", "PSM1"):
        system.asked("stop", name)
    system.goes_on()
    assert system.asked("start").answers == [("refused", "PSM1 needs IO1, which does not run: trocar start IO1")]
    assert system.asked("start", "PSM9").answers == [("refused", "no instance PSM9; there are IO1, PSM1")]


def test_whoever_waits_is_told_when_the_system_ends(system: IoAndArm) -> None:
    waiting = system.asked("restart")
    system.requests.end("the system stops")
    assert waiting.answers[-1] == ("failed", "the system stops")


def test_processes_start_in_waves_and_circles_are_named() -> None:
    clock = Clock()
    rows = [child.row for child, _ in (played("PSM1", "arm", clock, ("IO1",)), played("IO1", "io", clock))]
    assert [[row.name for row in wave] for wave in waves(rows)] == [["IO1"], ["PSM1"]]
    rows = [played("A", "arm", clock, ("B",))[0].row, played("B", "arm", clock, ("A",))[0].row]
    with pytest.raises(SetupError, match="A, B: each waits"):
        waves(rows)


def test_an_end_by_the_signal_to_stop_is_a_good_end(system: IoAndArm) -> None:
    child: Child = system.arm
    process: PlayedProcess = system.process
    child.stop()
    process.ends(-15)
    ending = child.look()
    assert ending is not None and ending.text == "stopped"


def test_what_runs_what_starts_and_what_waits_is_listed() -> None:
    clock = Clock()
    children = []
    for name, kind in (("PSM1", "arm"), ("box", "user"), ("gui", "gui")):
        child, process = played(name, kind, clock)
        children.append(child)
        if name != "gui":
            child.start()
            child.ensure()
        if name == "PSM1":
            process.goes_on()
    children[2].row = dataclasses.replace(children[2].row, start=ON_DEMAND)
    assert by_state(children) == "PSM1; starting: box; on demand: gui"
