"""The web console of a real system, without a browser: on demand, control, its death while a button is held."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from shm.ring import RingReader
from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_single_processes import row
from tests.system.test_socket_bridge import free

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"
Records = Callable[[Robot, str, str], RingReader]


class ScriptedPage:
    """What a page says and hears, without a browser around it."""

    def __init__(self, link: ClientConnection) -> None:
        self.link, self.number = link, 0

    def say(self, op: str, **parts: Any) -> None:
        """One message."""
        self.link.send(json.dumps({"op": op, **parts}))

    def hear(self, op: str) -> dict[str, Any]:
        """The next message of this kind."""
        while True:
            found: dict[str, Any] = json.loads(self.link.recv(timeout=60))
            if found["op"] == op:
                return found

    def call(self, to: str, command: str, *values: float, text: str = "") -> dict[str, Any]:
        """A command, and its end."""
        self.number += 1
        self.say("call", id=self.number, to=to, command=command, values=values, text=text)
        while True:
            found = self.hear("reply")
            if found.get("id") == self.number and found["outcome"] != "accepted":
                return found


@contextlib.contextmanager
def page(robot: Robot, port: int, **headers: str) -> Iterator[ScriptedPage]:
    """A page that connects, and leaves."""
    with connect(f"ws://127.0.0.1:{port}/live", additional_headers=headers) as link:
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


@pytest.mark.alone  # held up for a second, a console sends its pages away
def test_the_console_is_there_for_its_pages_and_its_death_ends_what_is_held(robot: Robot, records: Records) -> None:
    port = free()
    robot.up(KINEMATIC, "--set", f"gui.listen=127.0.0.1:{port}", "--set", "processes.gui.linger_s=0.2")
    assert row(robot, "gui")["lifecycle"] == "STOPPED"
    joint = (state := records(robot, "PSM1", "state")).field("position")

    def yaw() -> float:
        assert state.newest()
        return float(joint[0])

    with page(robot, port) as one, page(robot, port) as other:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=60) as response:
            assert b"PSM1" in response.read()
        assert "take control" in other.call("PSM1", "state_command", text="enable")["text"]
        one.say("control", take=True)
        for text in ("enable", "home"):
            assert one.call("PSM1", "state_command", text=text)["outcome"] == "done"
        one.say("want", sources=["PSM1/state", "scene", "processes", "messages"])
        data = one.hear("tick")["data"]
        assert data["PSM1/state"]["is_homed"] and len(data["scene"]["arms"]["PSM1"]["frames"]) == 8 * 7
        assert {"gui", "PSM1", "supervisor"} <= {process["name"] for process in data["processes"]["rows"]}
        before = yaw()
        end = time.monotonic() + 60.0
        while yaw() <= before and time.monotonic() < end:
            one.say("call", to="PSM1", command="servo_jv", values=[0.05, 0, 0, 0, 0, 0])
            time.sleep(0.05)
        assert yaw() > before
        os.kill(robot.pid("gui"), signal.SIGKILL)

        def rests() -> bool:
            before = yaw(), state.stamp_ns
            wait_for(lambda: yaw() is not None and state.stamp_ns > before[1] + 200_000_000, 30, "0.2 s of the system")
            return yaw() == before[0]

        wait_for(rests, 30, "the arm stands")
        with pytest.raises(ConnectionClosed):
            one.hear("nothing")

    def moves() -> bool:
        """Whether a page that comes now moves the arm; a console that a busy machine holds up sends it away."""
        try:
            with page(robot, port) as again:
                again.say("control", take=True)
                return again.call("PSM1", "move_jp", 0.1, 0, 0.12, 0, 0, 0)["outcome"] == "done"
        except ConnectionClosed:
            return False

    wait_for(moves, 60, "a page that comes later moves the arm")
    wait_for(lambda: row(robot, "gui")["lifecycle"] == "STOPPED", 20, "it ends when no page is there")
    assert robot.down() == 0


def test_what_was_asked_while_the_console_stood_still_is_not_done(robot: Robot, records: Records) -> None:
    port = free()
    robot.up(KINEMATIC, "--set", f"gui.listen=127.0.0.1:{port}")
    joint = (state := records(robot, "PSM1", "state")).field("position")
    with page(robot, port) as one:
        one.say("control", take=True)
        for text in ("enable", "home"):
            assert one.call("PSM1", "state_command", text=text)["outcome"] == "done"
        pid = robot.pid("gui")
        os.kill(pid, signal.SIGSTOP)
        end = time.monotonic() + 1.6
        while time.monotonic() < end:  # lies in the socket
            one.say("call", to="PSM1", command="servo_jv", values=[0.05, 0, 0, 0, 0, 0])
            time.sleep(0.05)
        one.say("call", to="PSM1", command="move_jp", values=[0.3, 0, 0.12, 0, 0, 0])
        os.kill(pid, signal.SIGCONT)
        with pytest.raises(ConnectionClosed):
            one.hear("nothing")
    assert state.newest()
    begin = state.stamp_ns
    wait_for(lambda: state.newest() and state.stamp_ns > begin + 300_000_000, 30, "0.3 s of the system")
    assert abs(joint[0]) < 1e-9 and robot.pid("gui") == pid
