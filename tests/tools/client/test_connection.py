"""A connection to a bridge that says odd things, or goes away: errors of ours, each with its reason."""

from __future__ import annotations

import json
import math
import socket
import threading
from collections.abc import Callable, Iterator

import pytest

from trocar.tools.client.connection import BridgeConnection
from trocar.tools.client.distant import DistantEvents, DistantRecord, DistantRemote
from trocar.tools.output.errors import Disconnected, Problem, Refused

Says = Callable[[dict[str, object]], bytes]
HELLO = {"op": "answer", "system": "s", "clock": "wall", "instances": {"PSM1": "PSM"}}


@pytest.fixture
def bridge() -> Iterator[Callable[[Says], BridgeConnection]]:
    """A connection to one that greets, and then answers as it is told to; nothing: it hangs up."""
    made: list[BridgeConnection] = []
    threads: list[threading.Thread] = []

    def serve(server: socket.socket, says: Says) -> None:
        client, _ = server.accept()
        with server, client, client.makefile("rb") as lines:
            for line in lines:
                asked = json.loads(line)
                data = json.dumps(HELLO | {"id": 1}).encode() + b"\n" if asked["op"] == "hello" else says(asked)
                if not data:
                    return
                client.sendall(data)

    def connect(says: Says) -> BridgeConnection:
        server = socket.create_server(("127.0.0.1", 0))
        threads.append(threading.Thread(target=serve, args=(server, says)))
        threads[-1].start()
        made.append(BridgeConnection(f"127.0.0.1:{server.getsockname()[1]}"))
        return made[-1]

    yield connect
    for connection in made:
        connection.close()
    for thread in threads:
        thread.join(20.0)


@pytest.mark.parametrize("says", [b"", b"HTTP/1.1 400 Bad Request\n", b"[]\n", b"null\n", b"{}\n", b"\xff\n"])
def test_one_that_hangs_up_or_is_no_bridge_is_gone(bridge: Callable[[Says], BridgeConnection], says: bytes) -> None:
    connection = bridge(lambda asked: says)
    with pytest.raises(Disconnected, match="is gone"):
        connection.ask("ping")


def test_an_error_is_a_problem_and_a_refusal_is_one_of_a_command(bridge: Callable[[Says], BridgeConnection]) -> None:
    def says(asked: dict[str, object]) -> bytes:
        return json.dumps({"op": "error", "id": asked["id"], "error": "no topic here"}).encode() + b"\n"

    connection = bridge(says)
    with pytest.raises(Problem, match="no topic here"):
        connection.ask("read", topic="x")
    with pytest.raises(Refused, match="no topic here"):
        DistantRemote(connection, "PSM1").ask("hold")
    with pytest.raises(ValueError, match="not numbers"):
        DistantRemote(connection, "PSM1").ask("move_jp", {"a": 1})  # type: ignore[arg-type]


def test_what_is_not_finite_is_sent_as_null_for_the_robot_to_refuse(bridge: Callable[[Says], BridgeConnection]) -> None:
    sent: list[object] = []

    def says(asked: dict[str, object]) -> bytes:
        sent.append(asked.get("values"))
        return json.dumps({"op": "error", "id": asked["id"], "error": "allowed: finite numbers"}).encode() + b"\n"

    with pytest.raises(Refused, match="finite"):
        DistantRemote(bridge(says), "PSM1").ask("move_jp", [0.5, math.nan, math.inf])
    assert sent[-1] == [0.5, None, None]


def test_a_flag_is_not_made_up_when_the_bridge_goes(bridge: Callable[[Says], BridgeConnection]) -> None:
    def says(asked: dict[str, object]) -> bytes:
        if asked["topic"] == "PSM1/orientation_locked":
            return b""
        return json.dumps({"op": "answer", "id": asked["id"], "age_s": 0.0, "stamp_ns": 1}).encode() + b"\n"

    record = DistantRecord(bridge(says), "PSM1")
    with pytest.raises(Disconnected):
        record.reported("orientation_locked")


def test_events_come_in_order_without_what_is_around_them(bridge: Callable[[Says], BridgeConnection]) -> None:
    def says(asked: dict[str, object]) -> bytes:
        number = 2 if asked["topic"] == "PSM1/status" else 1
        answer = {"op": "answer", "id": asked["id"]}
        record = {"op": "record", "topic": asked["topic"], "sequence": number, "text": "t", "age_s": 0.1}
        return b"".join(json.dumps(row).encode() + b"\n" for row in (answer, record))

    events = DistantEvents(bridge(says), "PSM1")
    events.follow("status")
    events.follow("warning")
    assert events.taken() == [("warning", {"sequence": 1, "text": "t"}), ("status", {"sequence": 2, "text": "t"})]
    assert events.taken() == []
