"""What is a message and what is not, in lines and in frames of a WebSocket; random bytes never break anything."""

from __future__ import annotations

import contextlib
import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.http11 import Response
from websockets.uri import parse_uri

from tests.cases import cases
from tests.examples import examples
from trocar.procs.crtk.messages import MAX_BYTES, Message, WrongMessage, parsed, said
from trocar.procs.socket_bridge.framing import Ended, LineFraming, WebSocketFraming, framing_of
from trocar.procs.socket_bridge.messages import OPS

ANY = st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
                   lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4))
CALL = {"op": "call", "to": "PSM1", "command": "move_jp"}


def outcome(data: bytes) -> Message | str:
    """The message, or why it is none."""
    try:
        return parsed(data, OPS)
    except WrongMessage as error:
        return str(error)


@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode(errors="replace")))
def test_random_bytes_are_messages_or_mistakes(data: bytes) -> None:
    assert outcome(data)


@examples(20)
@given(st.sampled_from(["hello", "read", "subscribe", "call", "set", "x"]),
       st.dictionaries(st.sampled_from(["id", "topic", "to", "command", "values", "text", "rate_hz", "of"]), ANY))
def test_random_parts_are_messages_or_mistakes(op: str, parts: dict[str, Any]) -> None:
    assert outcome(json.dumps({"op": op, **parts}).encode())


@cases("values", ["NaN", "[1" + "0" * 400 + "]", "[true]", '["1"]', "[[1]]", "{}", "1", '"x"'])
def test_what_are_no_numbers_is_a_mistake(values: str) -> None:
    assert isinstance(outcome(json.dumps(CALL)[:-1].encode() + f', "values": {values}}}'.encode()), str)


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999", "null"])
def test_what_is_not_finite_reaches_the_process_that_refuses_it_but_is_no_rate(value: str) -> None:
    call = outcome(json.dumps(CALL)[:-1].encode() + f', "values": [{value}]}}'.encode())
    assert isinstance(call, Message) and not math.isfinite(*call.parts["values"])
    assert isinstance(outcome(f'{{"op": "subscribe", "topic": "a", "rate_hz": {value}}}'.encode()), str)


def test_deep_nesting_is_a_mistake() -> None:
    for text in ("[" * 30000, '{"op":' * 9000, '{"op": "read", "topic": ' + "[" * 30000):
        assert isinstance(outcome(text.encode()), str)


def test_an_id_comes_back_with_the_mistake() -> None:
    with pytest.raises(WrongMessage, match="no op x") as caught:
        parsed(b'{"op": "x", "id": "a"}', OPS)
    assert caught.value.id == "a"
    assert json.loads(said("error", "a", error="x")) == {"op": "error", "id": "a", "error": "x"}


def test_defaults_stand_for_what_is_not_said() -> None:
    call = parsed(json.dumps(CALL).encode(), OPS)
    assert call.parts == {"to": "PSM1", "command": "move_jp", "values": (), "text": ""}
    assert parsed(b'{"op": "subscribe", "topic": "a"}', OPS).parts["rate_hz"] == 10.0


@given(st.lists(st.binary(min_size=1, max_size=50).filter(lambda part: b"\n" not in part and part.strip() == part
                                                          and part), max_size=10), st.integers(1, 20))
def test_lines_are_the_same_however_they_are_cut(lines: list[bytes], size: int) -> None:
    framing, found = LineFraming(), []
    data = b"".join(line + b"\n" for line in lines)
    for at in range(0, len(data), size):
        found += framing.feed(data[at : at + size])
    assert found == lines


def test_a_line_that_never_ends_ends_the_connection() -> None:
    framing = LineFraming()
    with pytest.raises(Ended, match=str(MAX_BYTES)):
        for _ in range(20):
            framing.feed(b"x" * 10000)


def test_the_first_bytes_tell_what_a_stream_is() -> None:
    assert framing_of(b"GE") is None and isinstance(framing_of(b"GET /"), WebSocketFraming)
    assert isinstance(framing_of(b'{"op'), LineFraming) and isinstance(framing_of(b"GEX"), LineFraming)


def shaken(origin: str = "") -> tuple[ClientProtocol, WebSocketFraming, Response]:
    """A client and a bridge after their handshake."""
    client, framing = ClientProtocol(parse_uri("ws://127.0.0.1/")), WebSocketFraming()
    request = client.connect()
    if origin:
        request.headers["Origin"] = origin
    client.send_request(request)
    with contextlib.suppress(Ended):
        framing.feed(b"".join(client.data_to_send()))
    client.receive_data(framing.waiting())
    (response,) = client.events_received()
    assert isinstance(response, Response)
    return client, framing, response


def test_frames_of_a_websocket_are_messages() -> None:
    client, framing, response = shaken()
    assert response.status_code == 101
    client.send_text(b"one")
    client.send_text(b"tw", fin=False)
    client.send_continuation(b"o", fin=True)
    client.send_ping(b"?")
    assert framing.feed(b"".join(client.data_to_send())) == [b"one", b"two"]
    client.receive_data(framing.waiting())
    assert [event.opcode for event in client.events_received() if isinstance(event, Frame)] == [Opcode.PONG]
    client.receive_data(framing.frame(b"three"))
    (frame,) = client.events_received()
    assert isinstance(frame, Frame) and frame.data == b"three"
    client.send_close()
    with pytest.raises(Ended):
        framing.feed(b"".join(client.data_to_send()))
    assert framing.frame(b"late") == b""


def test_a_page_in_a_browser_is_refused() -> None:
    _, _, response = shaken("http://127.0.0.1:8000")
    assert response.status_code == 403


def test_a_message_that_is_too_long_ends_a_websocket() -> None:
    client, framing, _ = shaken()
    client.send_text(b"x" * (MAX_BYTES + 1))
    with pytest.raises(Ended):
        framing.feed(b"".join(client.data_to_send()))


@given(st.binary(max_size=400))
def test_random_frames_break_nothing(data: bytes) -> None:
    _, framing, _ = shaken()
    try:
        for message in framing.feed(data):
            assert outcome(message)
    except Ended:
        pass
