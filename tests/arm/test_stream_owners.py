"""Who may stream to an arm, and for how long a stream that was ended stays ended, on a fake clock."""

from __future__ import annotations

from tests.arm.fake_requests import FakeRequest
from trocar.procs.node.requests import STREAM_PAUSE_NS
from trocar.procs.node.streams import StreamKind, Streams
from trocar.shm.mailbox.origins import Origin
from trocar.shm.memory.holders import Holder

MS = 1_000_000


def asked(program: str, effort: float = 1.0) -> FakeRequest:
    """A program asks for an effort."""
    return FakeRequest("servo_jf", [effort] * 6, origin=Origin(1, 0, program))


class Programs:
    """Streams on a fake clock; the first program is A."""

    def __init__(self) -> None:
        self.streams, self.now_ns = Streams(), 1_000 * MS

    def goal(self, sender: str = "A", kind: StreamKind = StreamKind.POSITION, after_ms: int = 1) -> str:
        """Why it is refused; "": it was taken."""
        self.now_ns += after_ms * MS
        why = self.streams.objection(kind, sender, asked(f"{sender}.py"), self.now_ns)
        if not why:
            self.streams.take(self.now_ns)
        return why

    def stop(self, by: str) -> None:
        self.streams.end(f"{by}.py stopped the arm (hold)", spared=by)


def test_one_program_streams_positions_until_it_has_paused() -> None:
    programs = Programs()
    assert not programs.goal("A")
    for _ in range(50):
        assert programs.goal("B") == "A.py is streaming positions; stop it first (hold)"
        assert not programs.goal("A")
    assert programs.goal("B", after_ms=99)
    assert not programs.goal("B", after_ms=2), "A has paused for 0.1 s"
    assert programs.goal("A") == "B.py is streaming positions; stop it first (hold)"


def test_the_program_that_sends_is_named_before_the_one_that_began_it() -> None:
    streams = Streams()
    teleop = FakeRequest("servo_cp", holder=Holder(4711, "MTMR_PSM1"), origin=Origin(1, 0, "matlab"))
    assert not streams.objection(StreamKind.POSITION, "teleop", teleop, MS)
    streams.take(MS)
    why = streams.objection(StreamKind.POSITION, "ros", FakeRequest("servo_jr"), 2 * MS)
    assert why.startswith("MTMR_PSM1 for matlab is streaming")


def test_wrist_jaw_and_efforts_may_come_from_different_programs() -> None:
    programs = Programs()
    for _ in range(10):
        assert not programs.goal("A", StreamKind.POSITION)
        assert not programs.goal("B", StreamKind.JAW)
        assert not programs.goal("C", StreamKind.EFFORT)
        assert not programs.goal("D", StreamKind.EFFORT)
        assert programs.goal("A", StreamKind.JAW)


def test_a_stream_that_an_arm_does_not_know_ends_when_its_process_restarts() -> None:
    programs = Programs()
    programs.streams.restart(programs.now_ns, "PSM1 stalled for 0.05 s")
    for _ in range(1000):
        assert programs.goal("A") == (
            "this stream has ended: PSM1 stalled for 0.05 s; pause for 0.5 s before the next one")
    assert not programs.goal("A", after_ms=500)
    programs.streams.restart(programs.now_ns, "PSM1 stalled for 0.05 s")
    assert not programs.goal("B", after_ms=500), "it begins later"


def test_what_takes_efforts_away_is_taken_at_once_after_a_restart() -> None:
    streams = Streams()
    streams.restart(0, "the arm's process was restarted")
    assert "restarted" in streams.objection(StreamKind.EFFORT, "A", asked("A", 1.0), 1)
    assert not streams.objection(StreamKind.EFFORT, "B", asked("B", 0.0), 1)


def test_a_stop_ends_the_streams_of_others_until_they_have_paused() -> None:
    programs = Programs()
    programs.goal("A")
    programs.goal("B", StreamKind.JAW)
    programs.stop("C")
    for _ in range(1000):
        assert programs.goal("A") == (
            "this stream has ended: C.py stopped the arm (hold); pause for 0.5 s before the next one")
        assert programs.goal("B", StreamKind.JAW)
    assert not programs.goal("C"), "who stopped them may begin at once"
    assert programs.goal("A", after_ms=490)
    assert not programs.goal("A", after_ms=500)
    assert not programs.goal("B", StreamKind.JAW)


def test_who_stops_the_arm_may_go_on_at_once() -> None:
    programs = Programs()
    programs.goal("A")
    programs.stop("A")
    assert not programs.goal("A")


def test_a_slow_stream_has_paused_after_three_of_its_periods() -> None:
    programs = Programs()
    for _ in range(4):
        assert not programs.goal("A", after_ms=300)
    programs.stop("B")
    for _ in range(10):
        assert programs.goal("A", after_ms=300)
    assert programs.goal("A", after_ms=899)
    assert not programs.goal("A", after_ms=900)


def test_goals_that_somebody_types_are_no_stream() -> None:
    programs = Programs()
    for _ in range(4):
        assert not programs.goal("A", after_ms=1500)
    programs.stop("B")
    assert not programs.goal("A", after_ms=1500)


def test_who_has_not_streamed_lately_is_not_stopped() -> None:
    programs = Programs()
    programs.goal("A")
    programs.now_ns += STREAM_PAUSE_NS
    programs.stop("B")
    assert not programs.goal("A", after_ms=0)


def test_many_programs_leave_no_trace() -> None:
    programs = Programs()
    for number in range(1000):
        assert not programs.goal(f"program {number}", after_ms=600)
    assert len(programs.streams._streams) <= 33


# an arm
