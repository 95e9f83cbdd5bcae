"""The web console of a real system, without a browser: on demand, control, its death while a button is held."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import socket
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, ConnectionClosedOK
from websockets.sync.client import ClientConnection, connect

from tests.system.conftest import systems
from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_single_processes import row
from tests.system.test_socket_bridge import COARSE, free
from trocar.shm.ring.ring import RingReader

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"
Records = Callable[[Robot, str, str], RingReader]


class ScriptedPage:
    """What a page says and hears, without a browser around it."""

    def __init__(self, link: ClientConnection) -> None:
        self.link, self.number, self.tick = link, 0, 0
        self._heard: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self.listening = threading.Thread(target=self._listen)
        self.listening.start()

    def _listen(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                found = json.loads(self.link.recv())
                self.tick = found["id"] if found["op"] == "tick" else self.tick
                self._heard.put(found)
        self._heard.put(None)

    def say(self, op: str, **parts: Any) -> None:
        """One message; what a person desired states goes with the newest tick that was heard."""
        desired = {"tick": self.tick} if op in ("beat", "jog", "call") else {}
        self.link.send(json.dumps({"op": op, **desired, **parts}))

    def hear(self, op: str) -> dict[str, Any]:
        """The next message of this kind."""
        while (found := self._heard.get(timeout=60)) is not None:
            if found["op"] == op:
                return found
        self._heard.put(None)
        raise ConnectionClosedOK(None, None)

    def take_control(self) -> None:
        """Until it has it."""
        self.say("control", take=True)
        while not self.hear("tick")["you"]:
            pass

    def call(self, to: str, command: str, *values: float, text: str = "") -> dict[str, Any]:
        """A command, and its end."""
        self.number += 1
        self.say("call", id=self.number, to=to, command=command, values=values, text=text)
        while True:
            found = self.hear("reply")
            if found.get("id") == self.number and found["outcome"] != "accepted":
                return found

    def asked(self, to: str, command: str, *values: float, text: str = "") -> None:
        """A command until it is done: what a busy machine brings late is refused, and takes control away."""
        end = time.monotonic() + 60.0
        while (found := self.call(to, command, *values, text=text))["outcome"] != "done" and time.monotonic() < end:
            self.take_control()
        assert found["outcome"] == "done", found


class SlowWay:
    """Between a page and the console: what the page says is delivered `late_s` later, what it hears at once."""

    def __init__(self, port: int) -> None:
        self.late_s, self._ends = 0.0, [socket.create_server(("127.0.0.1", 0))]
        self.port = self._ends[0].getsockname()[1]
        self._console = port
        self._said: queue.Queue[tuple[float, bytes]] = queue.Queue()
        self._threads = [threading.Thread(target=work) for work in (self._listen, self._deliver)]
        for thread in self._threads:
            thread.start()

    def _listen(self) -> None:
        page = self._ends[0].accept()[0]
        console = socket.create_connection(("127.0.0.1", self._console))
        self._ends += [page, console]
        back = threading.Thread(target=self._back, args=(page, console))
        back.start()
        with contextlib.suppress(OSError):
            while said := page.recv(65536):
                self._said.put((time.monotonic() + self.late_s, said))
        self._said.put((0.0, b""))
        console.close()
        back.join()

    def _back(self, page: socket.socket, console: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while heard := console.recv(65536):
                page.sendall(heard)

    def _deliver(self) -> None:
        with contextlib.suppress(OSError):
            while (row := self._said.get())[1]:
                time.sleep(max(0.0, row[0] - time.monotonic()))
                self._ends[2].sendall(row[1])

    def close(self) -> None:
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        for thread in self._threads:
            thread.join()


@contextlib.contextmanager
def page(robot: Robot, port: int, **headers: str) -> Iterator[ScriptedPage]:
    """A page that connects, and leaves."""
    with connect(f"ws://127.0.0.1:{port}/live", additional_headers=headers, open_timeout=120) as link:
        made, over = ScriptedPage(link), threading.Event()

        def beat() -> None:
            with contextlib.suppress(ConnectionClosed):
                while not over.wait(0.4):
                    made.say("beat")

        beating = threading.Thread(target=beat)
        made.hear("hello")
        robot.pids.add(robot.pid("gui"))
        beating.start()
        try:
            yield made
        finally:
            over.set()
            beating.join()
            link.close()
            made.listening.join()


def played(robot: Robot, scene: Callable[[], None]) -> None:
    """Play a scene; from its beginning where the machine was too busy for the console, which then closes its pages."""
    def attempt() -> str:
        try:
            scene()
        except ConnectionClosed as closed:
            return f"the console has closed its pages: {closed}"
        return ""

    problem = robot.retry(attempt, "a scene")
    assert not problem, problem


@pytest.mark.alone  # held up for a second, a console sends its pages away
def test_the_console_is_there_for_its_pages_and_its_death_ends_what_is_held(robot: Robot, records: Records) -> None:
    port = free()
    robot.up(KINEMATIC, *COARSE, "--set", f"gui.listen=127.0.0.1:{port}", "--set", "processes.gui.linger_s=0.2")
    assert row(robot, "gui")["lifecycle"] == "STOPPED"
    joint = (state := records(robot, "PSM1", "state")).field("position")

    def yaw() -> float:
        assert state.newest()
        return float(joint[0])

    def rests() -> bool:
        before = yaw(), state.stamp_ns
        wait_for(lambda: yaw() is not None and state.stamp_ns > before[1] + 200_000_000, 30, "0.2 s of the system")
        return yaw() == before[0]

    def dies_while_a_button_is_held() -> None:
        with page(robot, port) as one, page(robot, port) as other:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=60) as response:
                assert b"PSM1" in response.read()
            assert "take control" in other.call("PSM1", "state_command", text="enable")["text"]
            one.take_control()
            for text in ("enable", "home"):
                one.asked("PSM1", "state_command", text=text)
            one.say("want", sources=["PSM1/state", "scene", "processes", "messages"])
            while not (data := one.hear("tick")["data"]):
                pass
            assert data["PSM1/state"]["is_homed"] and len(data["scene"]["arms"]["PSM1"]["frames"]) == 8 * 7
            assert {"gui", "PSM1", "supervisor"} <= {process["name"] for process in data["processes"]["rows"]}
            before = yaw()
            end = time.monotonic() + 60.0
            while yaw() <= before and time.monotonic() < end:
                one.say("call", to="PSM1", command="servo_jv", values=[0.05, 0, 0, 0, 0, 0])
                one.take_control()
            assert yaw() > before
            os.kill(robot.pid("gui"), signal.SIGKILL)
            wait_for(rests, 30, "the arm stands")
            with pytest.raises(ConnectionClosed):
                one.hear("nothing")

    def comes_later_and_moves_the_arm() -> None:
        with page(robot, port) as again:
            again.take_control()
            again.asked("PSM1", "move_jp", 0.1, 0, 0.12, 0, 0, 0)

    played(robot, dies_while_a_button_is_held)
    played(robot, comes_later_and_moves_the_arm)
    wait_for(lambda: row(robot, "gui")["lifecycle"] == "STOPPED", 60, "it ends when no page is there")
    assert robot.down() == 0


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Robot, int]]:
    """A master, a slave and a console with a web console that may be stopped; its port."""
    port = free()
    with systems(tmp_path_factory.mktemp("pages"), "paced") as make:
        robot = make()
        robot.up(KINEMATIC.with_name("kinematic-teleop.yaml"), *COARSE, "--set", f"gui.listen=127.0.0.1:{port}",
                 "--set", "processes.gui.hung_s=60")
        yield robot, port


def test_on_a_slow_way_a_jog_ends_with_the_finger_and_control_with_the_page(
        shared: tuple[Robot, int], records: Records) -> None:
    robot, port = shared
    joint = (state := records(robot, "PSM1", "state")).field("position")
    velocity = state.field("velocity")

    def goes_slow_and_is_late() -> None:
        with contextlib.closing(SlowWay(port)) as way, page(robot, way.port) as one:
            one.take_control()
            for text in ("enable", "home"):
                one.asked("PSM1", "state_command", text=text)
            jog = {"to": "PSM1", "command": "servo_jv", "values": [0.05, 0, 0, 0, 0, 0]}
            assert state.newest()
            ticks, before, end = 0, float(joint[0]), time.monotonic() + 60
            while not (state.newest() and joint[0] > before) and time.monotonic() < end:
                one.say("call", **jog)
                one.take_control()
            wait_for(lambda: state.newest() and not velocity[0] and joint[0] > before, 30, "it has moved, and stands")
            one.asked("PSM1", "hold")  # so all that was said before has been heard
            assert state.newest()
            way.late_s, released = 4.0, float(joint[0])
            for _ in range(20):
                one.say("call", id="late", **jog)
                time.sleep(0.05)
            while one.hear("tick")["you"]:
                ticks += 1
                assert ticks < 1200, "by then nothing has come in time for a minute"
            refused: list[dict[str, Any]] = []
            while len(refused) < 20:
                refused += [row for row in (one.hear("reply"),) if row.get("id") == "late"]
            assert {(row["id"], row["outcome"]) for row in refused} == {("late", "refused")}
            assert state.newest() and joint[0] == released
            assert one.call("PSM1", "hold")["outcome"] == "done", "a stop counts however late"

    played(robot, goes_slow_and_is_late)


def test_an_emulated_operator_goes_with_the_last_page_that_had_control(
        shared: tuple[Robot, int], records: Records) -> None:
    robot, port = shared
    present = (state := records(robot, "console", "state")).field("operator_present")

    def comes() -> None:
        with page(robot, port) as one:
            one.take_control()

            def is_there() -> bool:
                one.asked("console", "emulate_operator_present", 1)
                return state.newest() and bool(present)

            wait_for(is_there, 60, "the operator is present")

    for _ in range(2):  # who goes from page to page in time takes the operator along; nobody is measured here
        played(robot, comes)
    wait_for(lambda: state.newest() and not bool(present), 30, "the operator is absent")


def test_what_was_asked_while_the_console_stood_still_is_not_done(
        shared: tuple[Robot, int], records: Records) -> None:
    robot, port = shared
    joint = (state := records(robot, "PSM1", "state")).field("position")

    stands = 0.0

    def stands_still() -> None:
        nonlocal stands
        with page(robot, port) as one:
            one.take_control()
            for text in ("enable", "home"):
                one.asked("PSM1", "state_command", text=text)
            assert state.newest()
            pid, stands = robot.pid("gui"), float(joint[0])
            os.kill(pid, signal.SIGSTOP)
            end = time.monotonic() + 1.6
            while time.monotonic() < end:  # lies in the socket
                one.say("call", to="PSM1", command="servo_jv", values=[0.05, 0, 0, 0, 0, 0])
                time.sleep(0.05)
            one.say("call", to="PSM1", command="move_jp", values=[0.3, 0, 0.12, 0, 0, 0])
            os.kill(pid, signal.SIGCONT)
            with pytest.raises(ConnectionClosed):
                one.hear("nothing")
            assert robot.pid("gui") == pid

    played(robot, stands_still)
    assert state.newest()
    begin = state.stamp_ns
    wait_for(lambda: state.newest() and state.stamp_ns > begin + 300_000_000, 30, "0.3 s of the system")
    assert abs(joint[0] - stands) < 1e-9
