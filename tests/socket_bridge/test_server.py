"""What clients get, and what they don't: records, commands, errors; limits and slow readers."""

from __future__ import annotations

import asyncio
import dataclasses
import math
import socket
from typing import Any

import pytest

from tests.socket_bridge.bridge import LOCAL, Bridge, bridge, run
from tests.tools.robot import ScriptedRobot
from trocar.procs.crtk.messages import MAX_BYTES
from trocar.procs.document.bridges import SocketBridge
from trocar.procs.machine.access import is_ours
from trocar.procs.node.requests import carry_out
from trocar.procs.socket_bridge import connection, session, topics
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriptions
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.inspect.messages import asked_rows

TOKEN = b"0123456789abcdef"


def story(world: Any, settings: SocketBridge = LOCAL, token: bytes = b"") -> Any:
    """A decorator: run the coroutine function on a bridge of its own."""
    def told(scenario: Any) -> None:
        async def whole() -> None:
            async with bridge(world.name, settings) as made:
                object.__setattr__(made.server.served, "token", token)
                await scenario(made)
        run(whole())
    return told


def test_a_topic_is_read_listed_and_subscribed_to(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            hello = await client.ask("hello", name="plan.py")
            assert (hello["protocol"], hello["system"], hello["grants"]) == (1, world.name, "command")
            listed = await client.ask("list")
            assert {"topic": "PSM1/measured_js", "kind": "js", "rate_hz": 1500.0} in listed["topics"]
            read = await client.ask("read", topic="PSM1/measured_js")
            assert read["position"] == [0.1] * 6 and read["velocity"] == [None] * 6 and read["valid"] is True
            await client.ask("subscribe", topic="PSM1/measured_cp", rate_hz=200)
            first = await client.hear("record")
            assert first["topic"] == "PSM1/measured_cp" and first["position"] == [1.0, 2.0, 3.0]
            made.robot.show_arm(0.2)
            second = await client.hear("record")
            assert second["sequence"] > first["sequence"] and "lost" not in second
            assert (await client.ask("unsubscribe", topic="PSM1/measured_cp"))["op"] == "answer"
            assert "no such subscription" in (await client.ask("unsubscribe", topic="PSM1/measured_cp"))["error"]


def test_events_come_each_and_the_last_one_first(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        made.robot.events.status("one", "PSM1")
        made.robot.events.status("two", "PSM1")
        async with made.client() as client:
            await client.ask("subscribe", topic="PSM1/status")
            assert (await client.hear("record"))["text"] == "PSM1: two"
            for text in ("three", "four", "five"):
                made.robot.events.status(text, "PSM1")
            texts = [(await client.hear("record"))["text"] for _ in range(3)]
            assert texts == ["PSM1: three", "PSM1: four", "PSM1: five"]
            await client.ask("subscribe", topic="PSM1/status", last=False)
            made.robot.events.status("six", "PSM1")
            assert (await client.hear("record"))["text"] == "PSM1: six"
            await client.ask("subscribe", topic="PSM1/operating_state")
            assert (await client.hear("record"))["state"] == "ENABLED"


def answering(robot: ScriptedRobot, seen: list[Any]) -> asyncio.Task[None]:
    """The arm takes what it is asked."""
    async def answer() -> None:
        while True:
            for request in robot.mailbox.drain(0):
                seen.append((request.name, request.values.tolist(), request.text, request.origin))
                request.accept()
                request.done("there")
            await asyncio.sleep(0.001)
    return asyncio.ensure_future(answer())


@pytest.mark.parametrize("value", [math.nan, None])
def test_what_is_not_finite_is_refused_by_the_arm_and_is_in_its_list_of_commands(
    world: Any, value: float | None
) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        audit = Audit(directory.writer(world.name, "PSM1", "audit", "arm"), monotonic_ns)
        made.robot.mailbox.close()
        arm = made.robot.mailbox = Mailbox(world.name, "PSM1", COMMANDS["arm"], audit=audit)
        async with made.client() as client:
            client.say("call", id="m", to="PSM1", command="move_jp", values=[0.1, 0, 0.12, 0, 0, value])
            await made.until(lambda: [carry_out(request, lambda _: None, 6) for request in arm.drain(0)])
            assert (await client.hear("reply"))["outcome"] == "refused"
        (row,) = asked_rows(world.name, "PSM1", 20)[0]
        assert row["outcome"] == "refused" and "finite" in row["reason"]


def test_a_command_is_a_person_s_and_its_end_is_told(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        seen: list[Any] = []
        arm = answering(made.robot, seen)
        async with made.client() as client:
            await client.ask("hello", name="plan.py")
            client.say("call", id="m", to="PSM1", command="move_jp", values=[0.1, 0, 0.12, 0, 0, 0])
            replies = [await client.hear("reply") for _ in range(2)]
            assert [reply["outcome"] for reply in replies] == ["accepted", "done"]
            assert replies[1]["text"] == "there" and replies[1]["id"] == "m"
            for _ in range(2):
                client.say("call", to="PSM1", command="servo_jp", values=[0.1, 0, 0.12, 0, 0, 0])
                assert [(await client.hear("reply"))["outcome"] for _ in range(2)] == ["accepted", "done"]
        arm.cancel()
        (_, values, _, origin), (_, _, _, first), (_, _, _, second) = seen
        assert values == [0.1, 0, 0.12, 0, 0, 0] and origin.id and origin.program == "plan.py"
        assert first == second != origin, "a stream is one command of a person"


@pytest.mark.slow
def test_what_a_client_holds_down_is_let_go_when_it_leaves(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = {row.name: row for row in COMMANDS["arm"]}
    rows["servo_jf"] = dataclasses.replace(rows["servo_jf"], ended_by="hold")
    monkeypatch.setitem(COMMANDS, "arm", tuple(rows.values()))

    @story(world)
    async def _(made: Bridge) -> None:
        seen: list[Any] = []
        arm = answering(made.robot, seen)
        async with made.client() as client:
            await client.ask("hello", name="plan.py")
            client.say("call", to="PSM1", command="servo_jf", values=[0.1] * 6)
            await client.hear("reply")
        await made.until(lambda: len(seen) == 2)
        arm.cancel()
        assert [name for name, *_ in seen] == ["servo_jf", "hold"]


WRONG = (
    ({"op": "call", "to": "PSM9", "command": "hold"}, "no component PSM9; did you mean PSM1"),
    ({"op": "call", "to": "PSM1", "command": "move_jpp"}, "PSM1 has no command move_jpp; did you mean move_jp"),
    ({"op": "call", "to": "PSM1", "command": "move_jp", "values": [1, "2"]}, "numbers"),
    ({"op": "call", "to": "PSM1", "command": "move_jp", "values": [0.0] * 65}, "up to 64"),
    ({"op": "call", "to": "PSM1", "command": "set_tool_type", "text": "x" * 65}, "allowed are 64"),
    ({"op": "call", "to": "../PSM1", "command": "hold"}, "no component"),
    ({"op": "read", "topic": "PSM1/measured_jss"}, "did you mean"),
    ({"op": "read", "topic": "PSM1/measured_js", "rat": 3}, "no part rat"),
    ({"op": "subscribe", "topic": "PSM1/measured_js", "rate_hz": 1e9}, "rate_hz has to be"),
    ({"op": "subscribe", "topic": "PSM1/measured_js", "rate_hz": 0}, "rate_hz has to be"),
    ({"op": "get", "of": "PSM1"}, "no topic PSM1/properties"),
    ({"op": "dance"}, "no op dance"), ({"op": "read"}, "topic is missing"))


def test_what_is_wrong_is_answered_with_its_reason(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            for message, why in WRONG:
                answer = await client.ask(**message)
                assert answer["op"] == "error" and why in answer["error"], message
            assert (await client.ask("ping"))["op"] == "answer"


def test_who_may_look_commands_nothing(world: Any) -> None:
    @story(world, dataclasses.replace(LOCAL, grants="view"))
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            assert (await client.ask("hello"))["grants"] == "view"
            answer = await client.ask("call", to="PSM1", command="hold")
            assert "is read-only" in answer["error"]
            assert (await client.ask("read", topic="PSM1/measured_js"))["valid"]


def test_who_may_not_power_moves_and_switches_off_all_the_same(world: Any) -> None:
    @story(world, dataclasses.replace(LOCAL, may_power=False))
    async def _(made: Bridge) -> None:
        seen: list[Any] = []
        arm = answering(made.robot, seen)
        async with made.client() as client:
            for text in ("enable", "home"):
                answer = await client.ask("call", to="PSM1", command="state_command", text=text)
                assert "may not power" in answer["error"]
            for command, text in (("state_command", "disable"), ("move_jp", "")):
                answer = await client.ask("call", to="PSM1", command=command, text=text)
                assert answer["outcome"] == "accepted" and (await client.hear("reply"))["outcome"] == "done"
        arm.cancel()
        assert [name for name, *_ in seen] == ["state_command", "move_jp"]


def test_others_show_the_token_first(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.procs.socket_bridge.server.is_ours", lambda peer, port: False)

    @story(world, token=TOKEN)
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            assert "hello with the token" in (await client.ask("list"))["error"]
            assert (await client.ask("hello", token=TOKEN.decode()))["protocol"] == 1
            assert (await client.ask("list"))["op"] == "answer"
        async with made.client() as client:
            assert (await client.ask("hello", token="0123456789abcdeX"))["error"] == "the token is wrong"
            assert await client.hear() == {}


@pytest.mark.slow
def test_programs_of_others_are_refused_without_a_token(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.procs.socket_bridge.server.is_ours", lambda peer, port: False)

    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            assert "need a token" in (await client.hear())["error"]
            assert await client.hear() == {}


def test_a_topic_is_wanted_while_one_client_wants_it(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        wanted = Subscriptions(made.robot.pages["PSM1"])

        def bits(group: str) -> int:
            wanted.look()
            return wanted.wanted & wanted.bits("state", group)

        assert not bits("")
        async with made.client() as one, made.client() as other:
            for client in (one, other):
                await client.ask("subscribe", topic="PSM1/body/measured_cf")
                await client.ask("subscribe", topic="PSM1/measured_js")
            groups = [group for group in ("wrench", "spatial_jacobian") if bits(group)]
            assert bits("") and groups == ["wrench"]
            await one.ask("unsubscribe", topic="PSM1/body/measured_cf")
            assert bits("wrench")
            await other.ask("unsubscribe", topic="PSM1/body/measured_cf")
            assert not bits("wrench") and bits("")
            await other.ask("read", topic="PSM1/body/measured_cf")
            await made.until(lambda: not bits("wrench"))  # a second later
        await made.until(lambda: not bits(""))
        assert not made.server.sessions


def test_a_slow_reader_loses_records_and_is_told_how_many(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client, made.client() as quick:
            await client.ask("subscribe", topic="PSM1/state", rate_hz=1000)
            await quick.ask("subscribe", topic="PSM1/state", rate_hz=1000)
            link = connection.Connection
            slow = [each for each in made.server.sessions if each.link.peer[1] == port_of(client)]  # type: ignore[attr-defined]
            monkeypatch.setattr(link, "is_slow", property(lambda each: each is slow[0].link and not done))
            done: list[bool] = []
            before = made.robot.arm.sequence
            for _ in range(5):
                made.robot.show_arm(0.3)
                expected = made.robot.arm.sequence
                while (await quick.hear("record"))["sequence"] < expected:
                    pass
            done.append(True)
            made.robot.show_arm(0.4)
            while "lost" not in (record := await client.hear("record")):
                pass
            assert record["lost"] >= 5 and record["sequence"] == before + 6
            assert made.server.served.counts.lost >= 5


def port_of(client: Any) -> int:
    return int(client.writer.get_extra_info("sockname")[1])


@pytest.mark.slow
def test_who_asks_and_never_reads_is_disconnected(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "MOST", 1 << 16)

    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            while made.server.sessions:  # what the kernel keeps for a slow reader grows with the load of the machine
                client.raw(b'{"op": "list"}\n' * 50)
                await asyncio.sleep(0.005)


def test_long_lines_end_a_connection_and_no_other(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as good, made.client() as client:
            await good.ask("ping")
            for _ in range(10):
                client.raw(b"x" * 1_000_000)
            try:
                heard = await client.hear()
            except (ConnectionError, asyncio.IncompleteReadError):
                heard = {}
            assert not heard or str(MAX_BYTES) in heard["error"]
            assert (await good.ask("ping"))["op"] == "answer"
            await made.until(lambda: len(made.server.sessions) == 1)


@pytest.mark.slow
def test_a_thousand_connections_leave_the_first_ones_alone(world: Any) -> None:
    @story(world, dataclasses.replace(LOCAL, max_clients=8))
    async def _(made: Bridge) -> None:
        async with made.client() as good:
            await good.ask("ping")
            turned_away = 0
            for _ in range(20):
                crowd = [await asyncio.open_connection("127.0.0.1", made.port) for _ in range(50)]
                for reader, writer in crowd:
                    writer.close()
                    turned_away += b"max_clients" in await reader.read(-1)
            assert turned_away >= 1000 - 20 * 8
            assert (await good.ask("ping"))["op"] == "answer"


@pytest.mark.slow
def test_another_protocol_is_shown_the_door(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        order = b'{"op": "call", "to": "PSM1", "command": "free"}\r\n'
        async with made.client() as client:  # what a web page can make a browser send
            client.raw(b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" + order)
            assert "no JSON" in (await client.hear())["error"]
            assert await client.hear() == {}
        assert made.server.served.counts.commands == 0
        async with made.client() as client:
            for _ in range(session.MANY_WRONG + 5):
                client.say("what")
                assert "no op what" in (await client.hear())["error"]
            client.raw(b"what?\n" * (session.MANY_WRONG + 2))
            while await client.hear():
                pass


def test_held_up_it_passes_nothing_on(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            await client.ask("ping")
            made.is_over = True
            client.say("call", to="PSM1", command="hold")
            await asyncio.sleep(0.05)
            assert not list(made.robot.mailbox.drain(0)) and made.server.served.counts.commands == 0


def test_a_topic_that_cannot_be_opened_is_one_client_s_problem(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client, made.client() as other:
            await other.ask("subscribe", topic="PSM1/measured_js", rate_hz=100)
            with monkeypatch.context() as patched:
                patched.setattr("trocar.procs.crtk.views.directory.reader", out_of_files)
                assert "Too many open files" in (await client.ask("read", topic="PSM1/measured_cp"))["error"]
                assert "Too many open files" in (await client.ask("subscribe", topic="PSM1/status"))["error"]
            with monkeypatch.context() as patched:
                patched.setattr(topics.Topics, "each", out_of_files)
                assert "Too many open files" in (await client.ask("subscribe", topic="PSM1/status"))["error"]
                assert "PSM1/status" not in made.server.served.topics._open
            assert (await client.ask("read", topic="PSM1/measured_cp"))["valid"]
            assert (await other.hear("record"))["topic"] == "PSM1/measured_js"


def out_of_files(*given: Any, **named: Any) -> None:
    raise OSError(24, "Too many open files")


def test_who_says_no_more_hears_the_answers(world: Any) -> None:
    @story(world)
    async def _(made: Bridge) -> None:
        async with made.client() as client:
            client.say("read", topic="PSM1/measured_js")
            client.say("call", to="PSM1", command="hold")
            client.writer.write_eof()
            seen: list[Any] = []
            arm = answering(made.robot, seen)
            heard = [await client.hear() for _ in range(4)]
            arm.cancel()
            assert sorted(row.get("outcome", row.get("op", "")) for row in heard) == ["", "accepted", "answer", "done"]
        await made.until(lambda: not made.server.sessions)


def test_only_a_program_that_lives_is_ours(world: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        client = socket.create_connection(("127.0.0.1", port))
        address = client.getsockname()
        accepted, _ = server.accept()
        assert is_ours(address, port)
        client.shutdown(socket.SHUT_WR)
        assert is_ours(address, port)
        client.close()
        assert not is_ours(address, port), "the kernel says it was root's"
        accepted.close()
