"""The socket bridge of a real system: its page's examples, its death while it streams, clients from elsewhere."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import connect

from tests.system.conftest import systems
from tests.system.robot import COARSE, ROOT, Robot, wait_for
from tests.system.test_single_processes import row
from trocar.shm.ring.ring import RingReader

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
PAGE = (ROOT / "docs" / "socket.md").read_text(encoding="utf-8")
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"
PATIENT = ("--set", "processes.socket_bridge.late_s=10")
"""A bridge that a busy machine holds up keeps its clients."""
LATE_S = 3.0
"""Of a bridge that is stopped for longer, when a test wants it to send its clients away."""
Records = Callable[[Robot, str, str], RingReader]


class SocketClient:
    """A program on a socket."""

    def __init__(self, port: int, wrap: Callable[[socket.socket], socket.socket] = lambda bare: bare) -> None:
        self.socket = wrap(socket.create_connection(("127.0.0.1", port), timeout=60))
        self.stream = self.socket.makefile("rw")

    def say(self, **message: Any) -> None:
        """One message."""
        self.stream.write(json.dumps(message) + "\n")
        self.stream.flush()

    def ask(self, **message: Any) -> dict[str, Any]:
        """A message, and its answer, or the end of a command."""
        self.say(id=1, **message)
        while True:
            found: dict[str, Any] = json.loads(self.stream.readline())
            if found.get("id") == 1 and found.get("outcome") != "accepted":
                return found

    def close(self) -> None:
        """Leave."""
        self.stream.close()
        self.socket.close()


def free() -> int:
    """A port where nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def started(robot: Robot, *options: str, address: str = "") -> int:
    """A system with one arm and a bridge; the port."""
    where = address or f"127.0.0.1:{free()}"
    robot.up(KINEMATIC, *COARSE, "--set", f"socket.listen={where}", *options)
    return int(where.rpartition(":")[2])


def homed(robot: Robot, port: int) -> SocketClient:
    """A client that has homed the arm."""
    client = SocketClient(port)
    for text in ("enable", "home"):
        assert client.ask(op="call", to="PSM1", command="state_command", text=text)["outcome"] == "done"
    robot.pids.add(robot.pid("socket_bridge"))
    return client


def example(language: str, port: int) -> str:
    """The code of the page, for this port."""
    (code,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return str(code).replace("7380", str(port))


def has_octave() -> bool:
    """Whether Octave and its package for sockets are there."""
    octave = shutil.which("octave-cli")
    return octave is not None and subprocess.run([octave, "--eval", "pkg load instrument-control"], check=False,
                                                 capture_output=True, timeout=60).returncode == 0


def test_the_page_s_examples_run_and_the_bridge_is_there_for_them_alone(robot: Robot, records: Records) -> None:
    port = started(robot, "--set", "processes.socket_bridge.linger_s=0.5", *PATIENT)
    assert row(robot, "socket_bridge")["lifecycle"] == "STOPPED"
    position = (state := records(robot, "PSM1", "state")).field("position")

    def run(*words: str) -> str:
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
        robot.pids.add(robot.pid("socket_bridge"))
        assert done.returncode == 0, done.stdout + done.stderr
        assert state.newest()
        return done.stdout

    def commands() -> int:
        return int(json.loads(robot.trocar("echo", "socket_bridge/state", "--once", "--json"))["commands"])

    assert '"orientation"' in run("bash", "-c", example("bash", port))
    assert abs(position[0] - 0.1) < 1e-4
    stays = SocketClient(port)  # so that one bridge serves all that follow, however long each takes to begin
    assert stays.ask(op="ping")["op"] == "answer"
    assert "0.1" in run(sys.executable, "-c", example("python", port))
    assert abs(position[1] - 0.1) < 1e-4
    if has_octave():
        run("octave-cli", "--eval", example("octave", port))
        assert abs(position[2] - 0.14) < 1e-5
    if shutil.which("nc"):
        (line,) = re.findall(r"^    (echo .* nc .*)$", PAGE, re.MULTILINE)
        assert '"position"' in run("bash", "-c", line.replace("7380", str(port)))
    with connect(f"ws://127.0.0.1:{port}", open_timeout=60) as web:
        web.send('{"op": "read", "topic": "PSM1/measured_js"}')
        assert json.loads(web.recv(timeout=30))["valid"] is True
    robot.pids.add(robot.pid("socket_bridge"))
    wait_for(lambda: commands() >= 3, 30, "it counts what was asked")
    stays.close()
    wait_for(lambda: row(robot, "socket_bridge")["lifecycle"] == "STOPPED", 60, "it ends when nobody is connected")
    assert robot.down() == 0


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Robot, int]]:
    """A system whose bridge may be stopped; its port."""
    with systems(tmp_path_factory.mktemp("socket"), "paced") as make:
        robot = make()
        yield robot, started(robot, "--set", f"processes.socket_bridge.late_s={LATE_S}", "--set",
                             "processes.socket_bridge.hung_s=60")
        robot.pids.add(robot.pid("socket_bridge"))
        assert robot.down() == 0


@pytest.mark.parametrize("how", ["kill -9", "stop and go"])
def test_the_arm_stops_when_the_bridge_that_streams_does(
        shared: tuple[Robot, int], records: Records, how: str) -> None:
    robot, port = shared
    client, state = homed(robot, port), records(robot, "PSM1", "state")
    joint = state.field("position")

    def yaw() -> float:
        assert state.newest()
        return float(joint[0])

    def say_jog() -> None:
        client.say(op="call", to="PSM1", command="servo_jv", values=[0.05, 0, 0, 0, 0, 0])

    def moves() -> bool:
        say_jog()
        return yaw() > 0.002

    def rests() -> bool:
        before = yaw(), state.stamp_ns
        wait_for(lambda: yaw() is not None and state.stamp_ns > before[1] + 100_000_000, 30, "0.1 s of the system")
        return yaw() == before[0]

    wait_for(moves, 60, "the arm moves")
    pid = robot.pid("socket_bridge")
    os.kill(pid, signal.SIGKILL if how == "kill -9" else signal.SIGSTOP)
    begin, stood = yaw(), state.stamp_ns
    if how != "kill -9":
        end = time.monotonic() + LATE_S + 1.0
        while time.monotonic() < end:  # nothing takes it now, it lies in the socket
            say_jog()
            time.sleep(0.02)
    wait_for(rests, 30, "the arm stands")
    assert yaw() - begin < 0.05 * 0.3 and state.stamp_ns > stood
    stands = yaw()
    if how != "kill -9":
        os.kill(pid, signal.SIGCONT)
    with pytest.raises((OSError, ValueError)):  # we are disconnected, in the middle of a word perhaps
        while True:
            client.ask(op="ping")
    again = SocketClient(port)
    assert again.ask(op="ping")["op"] == "answer"
    robot.pids.add(robot.pid("socket_bridge"))
    assert rests() and yaw() == stands, "nothing of what lay in the socket was done"
    assert again.ask(op="call", to="PSM1", command="move_jp", values=[0, 0, 0.12, 0, 0, 0])["outcome"] == "done"
    wait_for(lambda: state.newest() and np.allclose(joint[:3], [0, 0, 0.12], atol=1e-6), 30, "it moves on as asked")
    for each in (client, again):
        each.socket.close()


def test_a_hold_of_one_connection_ends_the_stream_of_another(shared: tuple[Robot, int]) -> None:
    robot, port = shared
    first, second = homed(robot, port), SocketClient(port)
    yaw, ids = 0.0, itertools.count(2)

    def refusal(client: SocketClient, by: float = 0.0) -> str:
        """Why a goal so far from the first one's last is refused; "": it is not."""
        number, goal = next(ids), [yaw + by, 0, 0.12, 0, 0, 0]
        client.say(op="call", id=number, to="PSM1", command="servo_jp", values=goal)
        while (found := json.loads(client.stream.readline())).get("id") != number:
            pass
        return str(found["text"]) if found["outcome"] == "refused" else ""

    def streams() -> bool:
        """Ten goals of the first one; false: after a pause, for the next try."""
        nonlocal yaw
        yaw += 0.001
        if not any(refusal(first) for _ in range(10)):
            return True
        time.sleep(1.0)
        return False

    def hold(client: SocketClient) -> bool:
        return str(client.ask(op="call", to="PSM1", command="hold")["outcome"]) == "done"

    wait_for(lambda: streams() and "is streaming positions" in refusal(second, 0.001), 60, "one streams")
    wait_for(lambda: streams() and hold(first) and streams(), 60, "who holds may go on at once")
    wait_for(lambda: streams() and hold(second) and "this stream has ended" in refusal(first), 60, "its end")
    wait_for(streams, 60, "it is followed again")
    for each in (first, second):
        each.close()


def test_clients_from_elsewhere_show_a_token_and_look(robot: Robot, tmp_path: Path) -> None:
    token, certificate, key = (tmp_path / name for name in ("token", "cert.pem", "key.pem"))
    if shutil.which("openssl") is None:
        pytest.skip("no openssl")
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=robot",
                    "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True)
    token.write_text("0123456789abcdef0123\n")
    token.chmod(0o600)
    address = f"0.0.0.0:{free()}"
    assert "anyone could connect" in robot.trocar("check", str(KINEMATIC), "--set", f"socket.listen={address}", code=1)
    port = started(robot, *PATIENT, "--set", f"socket.token_file={token}", "--set",
                   f"socket.tls={{certificate: {certificate}, key: {key}}}", address=address)
    context = ssl.create_default_context(cafile=str(certificate))
    client = SocketClient(port, lambda bare: context.wrap_socket(bare, server_hostname="robot"))
    assert "token" in client.ask(op="list")["error"]
    hello = client.ask(op="hello", token=token.read_text().strip())
    assert (hello["grants"], hello["may_power"]) == ("view", False)
    assert client.ask(op="read", topic="PSM1/operating_state")["state"] == "DISABLED"
    assert "is read-only" in client.ask(op="call", to="PSM1", command="state_command", text="enable")["error"]
    robot.pids.add(robot.pid("socket_bridge"))
    client.close()
