"""A process that starts when somebody connects: its socket is the supervisor's, so nobody is refused meanwhile."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from tests.supervisor.test_listening import free
from tests.system.robot import Robot, wait_for
from tests.system.test_single_processes import row

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
ECHO = """
import os, trocar

class Echo(trocar.Process):
    def setup(self):
        (self.server,) = self.listening
        self.clients = []
        self.watch(self.server)

    def main(self):
        while self.wait(1.0):
            self.process_messages()
            if self.is_ready(self.server):
                client, _ = self.server.accept()
                client.sendall(b"%d" % os.getpid())
                self.clients.append(client)  # for ever: who has gone is nobody's any more
"""


def answer(address: str) -> tuple[socket.socket, int]:
    """A connection, and the number of the process that answers at it."""
    host, _, port = address.partition(":")
    client = socket.create_connection((host, int(port)), timeout=30)
    return client, int(client.recv(100))


def test_who_connects_starts_it_and_waits_while_there_is_none(robot: Robot, tmp_path: Path) -> None:
    address = free()
    (tmp_path / "echo.py").write_text(ECHO)
    file = tmp_path / "lab.json"
    rows = [{"name": "echo", "module": "echo.py", "listen": address, "linger_s": 0.3}]
    file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "trocar": {"processes": rows}}))
    robot.up(file)
    assert row(robot, "echo")["lifecycle"] == "STOPPED" and row(robot, "echo")["listen"] == [address]
    assert "cannot listen" in robot.trocar("up", str(file), "--system", f"{robot.name}-two", code=1)
    client, first = answer(address)
    robot.pids.add(first)
    with client:
        robot.kill("echo")
        again, second = answer(address)  # nobody is there: it waits in the queue
        robot.pids.add(second)
    assert second != first
    again.close()
    wait_for(lambda: row(robot, "echo")["lifecycle"] == "STOPPED", 20, "it ends when nobody is connected any more")
    third_client, third = answer(address)
    third_client.close()
    robot.pids.add(third)
    assert third not in (first, second) and row(robot, "echo")["restarts"] == 1
    assert robot.down() == 0
    with pytest.raises(ConnectionRefusedError):
        answer(address)
