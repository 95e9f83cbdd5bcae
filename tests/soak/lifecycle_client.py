"""One of the clients of tests/soak/lifecycle.py: it does what it is told, line by line, until it is killed."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from typing import Any

from trocar.procs.machine.paths import ROOT
from trocar.shm.mailbox.client import Client
from trocar.shm.system.subscriptions import Subscriber

SUPERVISOR = "supervisor"


class LifecycleClient:
    """The other end: a process of its own, and what it has asked for."""

    def __init__(self, system: str) -> None:
        words = [sys.executable, "-m", "tests.soak.lifecycle_client", system]
        self._popen = subprocess.Popen(words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.wants: set[str] = set()
        self.connected = False
        self.asked: dict[int, str] = {}
        """The outcome of each request by its number; empty: none yet."""

    def tell(self, *words: object) -> Any:
        """Let it do something; returns what it says."""
        assert self._popen.stdin is not None and self._popen.stdout is not None
        self._popen.stdin.write(json.dumps(words) + "\n")
        self._popen.stdin.flush()
        return json.loads(self._popen.stdout.readline())

    def ask(self, verb: str, name: str) -> int:
        """start, stop or restart a process; returns the number of the request."""
        number = int(self.tell("ask", verb, name))
        self.asked[number] = ""
        return number

    def poll(self) -> None:
        """Hear what became of the requests."""
        for number, outcome in self.tell("poll"):
            if outcome != "accepted":
                assert not self.asked[number], f"request {number} was answered twice: {self.asked[number]}, {outcome}"
                self.asked[number] = outcome

    def want(self, name: str, topic: str) -> None:
        """Subscribe."""
        self.tell("want", name, topic)
        self.wants.add(name)

    def drop(self, name: str) -> None:
        """Unsubscribe."""
        self.tell("drop", name)
        self.wants.discard(name)

    def connect(self, port: int) -> None:
        """Connect, or leave."""
        self.connected = bool(self.tell("connect", 0 if self.connected else port))

    def kill(self) -> None:
        """kill -9."""
        self._popen.kill()
        self._popen.communicate()


def main() -> None:
    """Lines in, lines out."""
    system = sys.argv[1]
    client, subscribers = Client(system, SUPERVISOR), dict[str, Subscriber]()
    connection: socket.socket | None = None
    for line in sys.stdin:
        verb, *words = json.loads(line)
        said: object = None
        if verb == "ask":
            said = client.send(words[0], (), words[1])
        elif verb == "poll":
            said = [(reply.id, reply.outcome) for reply in client.poll()]
        elif verb == "want":
            subscriber = subscribers.get(words[0]) or Subscriber(system, words[0], "lifecycle")
            subscribers[words[0]] = subscriber
            subscriber.want(words[1])
        elif verb == "drop":
            subscribers.pop(words[0]).close()
        elif verb == "connect":
            if connection is not None:
                connection.close()
            connection = socket.create_connection(("127.0.0.1", words[0]), timeout=5.0) if words[0] else None
            said = connection is not None
        print(json.dumps(said), flush=True)


if __name__ == "__main__":
    main()
