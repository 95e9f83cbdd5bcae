"""Commands to one component: how long an answer is waited for."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

import pytest

from tests.tools.robot import ScriptedRobot
from tests.tools.test_verbs import kinematic as kinematic  # a fixture
from trocar.shm.mailbox.client import Reply
from trocar.shm.time.control_page import ControlPage
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Problem

PATIENCE_S = 0.2


class SimulatedTime:
    """A system's time that is another one than ours."""

    simulated = True

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self.now_ns = now_ns

    def close(self) -> None:
        """Nothing is held."""


def test_an_answer_is_waited_for_while_simulated_time_stands(
        kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    def answer() -> None:
        time.sleep(2 * PATIENCE_S)
        while not (asked := list(kinematic.mailbox.drain())):
            time.sleep(0.001)
        asked[0].done()

    monkeypatch.setattr("trocar.tools.client.remote.SystemTime", lambda _: SimulatedTime(lambda: 0))
    with Remote(kinematic.name, "PSM1") as remote:
        late = threading.Thread(target=answer)
        late.start()
        assert remote.ask("hold", timeout=PATIENCE_S).outcome == "done"
        late.join()


def test_nobody_waits_longer_than_asked_while_simulated_time_goes_on(
        kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.tools.client.remote.SystemTime", lambda _: SimulatedTime(time.monotonic_ns))
    with Remote(kinematic.name, "PSM1") as remote, pytest.raises(Problem, match=r"did not answer hold within 0\.2 s"):
        remote.ask("hold", timeout=PATIENCE_S)


def test_a_command_waits_while_its_component_starts(kinematic: ScriptedRobot) -> None:
    page = ControlPage(kinematic.name, "PSM1", write=True)
    with contextlib.closing(page), Remote(kinematic.name, "PSM1") as remote:
        page.show("STARTING")

        def start() -> None:
            time.sleep(PATIENCE_S)
            kinematic.mailbox.refuse_waiting("PSM1 has just started; try again")
            page.show("RUNNING")
            while not (asked := list(kinematic.mailbox.drain())):
                time.sleep(0.001)
            asked[0].done()

        starting = threading.Thread(target=start)
        starting.start()
        assert remote.ask("hold", timeout=5.0).outcome == "done"
        starting.join()


@pytest.mark.parametrize(("state", "words"), [("STOPPED", "is not running"), ("FAILED", "has failed")])
def test_a_command_to_a_component_that_was_stopped_says_so_at_once(
        kinematic: ScriptedRobot, state: str, words: str) -> None:
    with contextlib.closing(ControlPage(kinematic.name, "PSM1", write=True)) as page, \
            Remote(kinematic.name, "PSM1") as remote:
        page.show(state)
        kinematic.beat()
        with pytest.raises(Problem, match=f"PSM1 {words}; trocar status says why, trocar start PSM1 starts it"):
            remote.ask("hold")


def test_without_a_working_supervisor_no_process_is_said_to_start_by_command(kinematic: ScriptedRobot) -> None:
    kinematic.pages["PSM1"].show("STOPPED")
    kinematic.pages["supervisor"].field("heartbeat_ns")[...] = time.monotonic_ns() - 5_000_000_000
    with Remote(kinematic.name, "PSM1") as remote, pytest.raises(Problem, match="supervisor is stalled: trocar down"):
        remote.wait_until_it_runs()


def test_later_answers_are_put_back_under_the_lock_of_all_threads(
        kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    with Remote(kinematic.name, "PSM1") as remote:
        accepted, done = Reply(1, "accepted", ""), Reply(1, "done", "")

        class WatchedInbox(list[Reply]):
            """An inbox that another thread wants to replace while answers are put back into it."""

            def __setitem__(self, *_: object) -> None:
                taking = threading.Thread(target=lambda: found.extend(remote.poll()), daemon=True)
                taking.start()
                taking.join(PATIENCE_S)
                assert taking.is_alive(), "a thread that replaces it now loses them"
                list.__setitem__(self, *_)  # type: ignore[arg-type]
                takers.append(taking)

        found: list[Reply] = []
        takers: list[threading.Thread] = []
        remote.inbox = WatchedInbox()
        monkeypatch.setattr(remote, "replies_to", lambda number: [accepted, done])
        monkeypatch.setattr(remote, "post", lambda *_: 1)
        assert remote.answered("hold") is accepted
        takers[0].join()
        assert found == [done]
