"""Whatever three clients ask for in whatever order, and whatever the process does: compared with a model each step.

The model: an instance that was last asked to run has a process or is going to have one, one that was asked to stop has
none in the end; setup, main and quit follow each other; whoever asked is answered, once.
"""

from __future__ import annotations

import itertools

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from tests.examples import examples
from tests.supervisor.played import Clock, PlayedRequest, played
from trocar.procs.supervisor.requests import Requests
from trocar.procs.tables import lifecycle

pytestmark = pytest.mark.slow

CLIENTS = st.integers(0, 2)
NEXT = {"setup": ("main", "quit", "killed"), "main": ("quit", "killed"), "quit": ("setup",), "killed": ("setup",)}
FINAL = ("done", "failed", "refused")


class AnyOrder(RuleBasedStateMachine):
    """Three clients, one instance."""

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.child, self.process = played("force", "arm", self.clock)
        self.requests = Requests([self.child])
        self.asked: list[list[PlayedRequest]] = [[], [], []]
        self.wanted = False

    def _ask(self, client: int, name: str) -> None:
        request = PlayedRequest(name, "force")
        self.asked[client].append(request)
        self.requests.take(request)  # type: ignore[arg-type]  # what is not asked for is not played
        self.child.ensure()
        self.wanted = name != "stop"

    @rule(client=CLIENTS, name=st.sampled_from(("start", "stop", "restart")))
    def ask(self, client: int, name: str) -> None:
        """Somebody asks for something."""
        self._ask(client, name)

    @rule()
    def go_on(self) -> None:
        """The process gets time."""
        self.process.goes_on()

    @rule(seconds=st.sampled_from((0.02, 0.5, 4.0, 61.0)))
    def beat(self, seconds: float) -> None:
        """The supervisor looks."""
        self.clock.passes(seconds)
        self.child.look()
        self.child.ensure()
        self.requests.answer()

    @rule(code=st.sampled_from((0, 3, -9)))
    def die(self, code: int) -> None:
        """It ends by itself, or somebody kills it."""
        self.process.ends(code)

    @rule()
    def hang(self) -> None:
        """It does nothing any more, whatever it is asked for."""
        self.process.hangs = True

    @invariant()
    def every_process_lives_in_order(self) -> None:
        """Setup, main, quit; the next one only then (`begin` refuses a second one)."""
        notes = self.process.notes
        assert not notes or notes[0] == "setup"
        assert all(after in NEXT[before] for before, after in itertools.pairwise(notes))

    @invariant()
    def the_state_says_whether_there_is_a_process(self) -> None:
        """There is one in every state but STOPPED, until the supervisor has looked."""
        there = self.process.runs or self.process._code is not None
        assert there == (self.child.state != lifecycle.STOPPED)

    @invariant()
    def the_last_one_who_asked_gets_what_he_wants(self) -> None:
        """It is going to run, or to end; a policy that has given up says so."""
        going = self.child.state in (lifecycle.RUNNING, lifecycle.RESTARTING) or self.child.restart_at_ns > 0
        assert going == self.wanted or (self.wanted and self.child.given_up)

    @invariant()
    def nobody_is_answered_twice(self) -> None:
        """At most one final answer."""
        for request in (each for client in self.asked for each in client):
            assert sum(outcome in FINAL for outcome, _ in request.answers) <= 1

    def teardown(self) -> None:
        """In the end everybody is answered, and a stop leaves nothing."""
        self._ask(0, "stop")
        for _ in range(4):
            self.process.goes_on()
            self.clock.passes(4.0)
            self.child.look()
            self.child.ensure()
            self.requests.answer()
        assert not self.process.runs and self.child.is_down
        for request in (each for client in self.asked for each in client):
            assert request.answers and request.answers[-1][0] in FINAL


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = examples(50, stateful_step_count=60)
