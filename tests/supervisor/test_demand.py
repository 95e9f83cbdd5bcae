"""When a process on demand is started and stopped, on a counted clock."""

from __future__ import annotations

import dataclasses

from tests.supervisor.played import Clock, played
from trocar.procs.supervisor.children import Demand


class Wanted:
    """One instance on demand, and whether somebody wants it."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.child, self.process = played("force", "arm", self.clock)
        self.child.row = dataclasses.replace(self.child.row, start="on-demand", linger_s=2.0)
        self.wanted, self.possible, self.refused, self.just_came = False, True, False, False
        self.demand = Demand(self.child, self.is_wanted, lambda: self.possible)

    def is_wanted(self, refused: bool, last: bool) -> bool:
        """As the test says."""
        self.refused = refused and not last
        return self.wanted or (last and self.just_came)

    def goes_on(self, seconds: float, wanted: bool) -> str:
        """Time in beats of 20 ms; the state after it."""
        self.wanted = wanted
        for _ in range(round(seconds / 0.02)):
            self.clock.passes(0.02)
            self.process.goes_on()
            self.child.look()
            self.demand.beat()
            self.child.ensure()
        return self.child.state


def test_the_first_who_wants_it_starts_it_and_it_stops_after_the_last() -> None:
    force = Wanted()
    assert force.goes_on(10.0, False) == "STOPPED" and force.process.begun == 0
    assert force.goes_on(0.1, True) == "RUNNING"
    assert force.goes_on(1.9, False) == "RUNNING", "it lingers"
    assert force.goes_on(1.0, True) == "RUNNING" and force.process.begun == 1, "somebody came back"
    assert force.goes_on(2.2, False) == "STOPPED"
    assert force.goes_on(0.1, True) == "RUNNING" and force.process.begun == 2


def test_who_has_come_since_the_last_look_keeps_it_up() -> None:
    force = Wanted()
    force.goes_on(0.1, True)
    force.just_came = True
    assert force.goes_on(10.0, False) == "RUNNING"
    force.just_came = False
    assert force.goes_on(2.2, False) == "STOPPED"


def test_who_comes_while_it_stops_gets_a_new_one() -> None:
    force = Wanted()
    force.goes_on(0.1, True)
    force.process.hangs = True
    assert force.goes_on(2.2, False) == "STOPPING"
    assert force.goes_on(0.1, True) == "RESTARTING"
    force.process.hangs = False
    assert force.goes_on(0.1, True) == "RUNNING" and force.process.begun == 2


def test_what_a_person_asked_for_by_hand_stands() -> None:
    force = Wanted()
    force.child.start()
    assert force.goes_on(60.0, False) == "RUNNING"
    force.goes_on(0.1, True)
    force.child.stop()
    assert force.goes_on(60.0, True) == "STOPPED" and force.refused
    force.goes_on(3.0, False)
    assert not force.refused
    assert force.goes_on(0.1, True) == "RUNNING"


def test_it_waits_for_what_it_needs() -> None:
    force = Wanted()
    force.possible = False
    assert force.goes_on(5.0, True) == "STOPPED"
    force.possible = True
    assert force.goes_on(0.1, True) == "RUNNING"


def test_one_that_dies_while_it_is_wanted_comes_back() -> None:
    force = Wanted()
    force.goes_on(0.1, True)
    force.process.ends(3)
    assert force.goes_on(0.5, True) == "RUNNING" and force.process.begun == 2


def test_one_that_ends_by_itself_while_nobody_wants_it_has_not_died() -> None:
    force = Wanted()
    force.goes_on(0.1, True)
    assert force.goes_on(0.1, False) == "RUNNING"
    force.process.ends(0)
    assert force.goes_on(0.1, False) == "STOPPED" and force.child.reason == "done" and force.child.is_down
    assert force.goes_on(0.1, True) == "RUNNING", "who comes within its linger time gets a new one"
    force.goes_on(0.1, False)
    force.process.ends(0)
    force.wanted = True  # just then
    assert force.goes_on(0.1, True) == "RUNNING" and force.process.begun == 3 and force.child.restarts == 0


def test_one_that_is_stopped_while_nobody_wants_it_is_there_for_the_next() -> None:
    for has_ended in (True, False):
        force = Wanted()
        force.goes_on(0.1, True)
        force.goes_on(0.1, False)
        force.process.hangs = not has_ended
        force.child.stop()
        assert force.goes_on(0.1, False) == ("STOPPED" if has_ended else "STOPPING")
        force.goes_on(0.1, True)
        force.process.hangs = False
        assert force.goes_on(0.1, True) == "RUNNING", "within its linger time"
        force.goes_on(5.0, False)
        assert force.child.is_down
