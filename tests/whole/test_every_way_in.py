"""All commands through every way in: who is let through follows from the rows of the table alone."""

from __future__ import annotations

import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import pytest

from tests.cases import cases
from tests.conftest import World
from trocar.procs.crtk.calls import Calls, CommandOwner
from trocar.procs.crtk.last_look import LastLook
from trocar.procs.crtk.messages import WrongMessage
from trocar.procs.document.bridges import Rights, RosBridge
from trocar.procs.gui.browsers import Browsers, ConsoleService
from trocar.procs.ros_bridge import carrying_out
from trocar.procs.ros_bridge.carrying_out import Addressee, AskedTopic, Commands
from trocar.procs.ros_bridge.incoming import CommandTopic
from trocar.procs.ros_messages.command_messages import CommandMessage
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.client import Client, LoopClient
from trocar.shm.mailbox.command_row import ANY, JOINTS, SOME, ZERO, Argument, CommandRow, Effect
from trocar.shm.mailbox.generations import FaultCell, Faults, create_faults
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.mailbox.origins import Origin
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import create_control
from trocar.tools.client.remote import Remote

KINDS = [kind for kind in COMMANDS if kind != "third_party"]
OWNER = "X"
AUTHORIZED = (Effect.RELAX, Effect.RELEASE, Effect.MOTION, Effect.POWER)
POWERFUL = (Effect.RELAX, Effect.RELEASE, Effect.POWER)
Case = tuple[CommandRow, str, list[float]]


def numbers(argument: Argument, value: float) -> list[float]:
    """Of one argument, all as near to `value` as it allows."""
    count = {JOINTS: 6, SOME: 1}.get(argument.size, argument.size)
    nearest = min(max(value, argument.low + argument.above * 1e-3), argument.high)
    return [float(round(nearest)) if argument.whole else nearest] * count


def every_case(kind: str) -> Iterator[Case]:
    """Every row with all of its texts, and with values that are all 0, all 1 and others."""
    for row in COMMANDS[kind]:
        words = row.text.split("|") if "|" in row.text and " " not in row.text else ["PSM1" if row.text else ""]
        for text in words:
            for value in (0.0, 1.0, 0.3):
                yield row, text, [number for each in row.arguments for number in numbers(each, value)]


def effect(row: CommandRow, text: str, values: list[float]) -> Effect:
    """What the columns say, in the words of their definition."""
    zero, one = not any(values), bool(values) and all(value == 1.0 for value in values)
    if text in row.stops or ANY in row.stops or (ZERO in row.stops and zero):
        return Effect.SETTING
    if text in row.effect_of_words:
        return row.effect_of_words[text]
    if zero and row.effect_of_zero is not None:
        return row.effect_of_zero
    return row.effect_of_one if one and row.effect_of_one is not None else row.effect


def is_powerful(row: CommandRow, text: str, values: list[float]) -> bool:
    """Whether it needs `may_power`: its own effect, or one of those that it causes in turn."""
    own = effect(row, text, values)
    return own in POWERFUL or (own in AUTHORIZED and any(each in POWERFUL for each in reached(row, set())))


def reached(row: CommandRow, seen: set[int]) -> Iterator[Effect]:
    for cause in row.causes:
        kind, _, name = cause.partition(".")
        for other in COMMANDS[kind]:
            if name in ("*", other.name) and id(other) not in seen:
                seen.add(id(other))
                yield other.effect
                yield from reached(other, seen)


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def box(world: World, kind: str) -> Iterator[Mailbox]:
    create_control(world.name, OWNER)
    create_mailbox(world.name, OWNER, kind, COMMANDS[kind])
    create_faults(world.name, (OWNER,))
    faults = Faults(world.name, write=True)
    cell = FaultCell(faults, OWNER)
    cell.fault()
    owner = Mailbox(world.name, OWNER, COMMANDS[kind], guard=cell)
    yield owner
    owner.close()
    faults.close()
    world.remove()


def came(box: Mailbox) -> list[str]:
    """Commands that came through to their owner."""
    found = []
    for command in box.drain():
        command.done()
        found.append(command.name)
    return found


@pytest.mark.parametrize("origin", [Origin(0, 0, ""), Origin(7, 0, "before the fault"), Origin(8, 1, "after it")])
def test_the_mailbox_lets_a_process_through_with_an_operators_command_or_where_none_is_needed(
        world: World, kind: str, box: Mailbox, origin: Origin) -> None:
    client = LoopClient(world.name, OWNER)
    client.on_behalf(origin)
    for row, text, values in every_case(kind):
        assert client.send(row.name, values, text)
        needed = effect(row, text, values) in AUTHORIZED
        assert (came(box) == [row.name]) is (origin.generation == 1 or not needed), (row.name, text, values)
        client.poll()
    client.close()


def test_the_command_line_and_python_are_operators_whose_commands_always_count(
        world: World, kind: str, box: Mailbox) -> None:
    with Remote(world.name, OWNER) as remote:
        assert isinstance(remote, Client)
        for row, text, values in every_case(kind):
            remote.send(row.name, values, text)
            assert came(box) == [row.name], (row.name, text, values)
            remote.poll()


@pytest.mark.parametrize("rights", [Rights(True, False, False), Rights(True, True, False), Rights(True, True, True)])
def test_the_socket_lets_through_what_its_rights_allow(world: World, kind: str, box: Mailbox, rights: Rights) -> None:
    owners = {OWNER: CommandOwner(kind, {row.name: row for row in COMMANDS[kind]})}
    calls = Calls(world.name, owners, rights, lambda: False)
    for row, text, values in every_case(kind):
        allowed = rights.commands and (rights.powers or not is_powerful(row, text, values))
        if allowed:
            calls.send(1, OWNER, row.name, values, text)
        else:
            with pytest.raises(WrongMessage):
                calls.send(1, OWNER, row.name, values, text)
        assert came(box) == [row.name] * allowed, (row.name, text, values)
        list(calls.replies())
    calls.close()


@pytest.mark.parametrize("may_power", [False, True])
def test_ros_lets_through_what_it_may_power(
        world: World, kind: str, box: Mailbox, may_power: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(carrying_out, "JOINING_NS", 0)  # streams begin at once
    writer = SimpleNamespace(participant_key=uuid4())
    participant: Any = SimpleNamespace(reader=lambda *_: SimpleNamespace(writer=lambda handle: writer),
                                       read_as=lambda *_, latched: SimpleNamespace(take=list))  # names no node
    message = SimpleNamespace(sample_info=SimpleNamespace(publication_handle=1, source_timestamp=0))
    said: list[str] = []
    refusals: Any = SimpleNamespace(say=lambda to, text: said.append(to))
    absent: Any = None
    faults = Faults(world.name)
    last_look = LastLook(faults.generation)
    commands = Commands(participant, world.name, [Addressee(OWNER, kind)], RosBridge(may_power=may_power), refusals,
                        joints=lambda view: absent, last_look=last_look, refuse_move=lambda to: None)
    for row, text, values in every_case(kind):
        last_look.look()
        if row.ros is None:
            continue
        taken = CommandMessage(SimpleNamespace, numbers=lambda _, values=values: values,  # type: ignore[arg-type]
                               text=lambda _, text=text: text)  # type: ignore[misc]
        commands._carry_out(AskedTopic(participant.reader(), CommandTopic(kind, row.name, row, taken), OWNER), message)
        allowed = may_power or not is_powerful(row, text, values)
        assert came(box) == [row.name] * allowed, (row.name, text, values)
        assert bool(said) is not allowed
        said.clear()
        commands.hear()
    commands.close()
    faults.close()


@pytest.mark.parametrize("has_control", [False, True])
def test_a_page_without_control_gives_stops_only(world: World, kind: str, box: Mailbox, has_control: bool) -> None:
    owners = {OWNER: CommandOwner(kind, {row.name: row for row in COMMANDS[kind]})}
    absent: Any = SimpleNamespace(leave=lambda wants: None)
    socket: Any = SimpleNamespace()
    browsers = Browsers(ConsoleService(world.name, owners, absent, lambda: False, absent, "r", lambda: 1))
    page = browsers.come(socket, "page")
    service = browsers.served
    for row, text, values in every_case(kind):
        now_ns = monotonic_ns()
        if has_control:
            service.control.take("page", now_ns, over=True)
        tick = service.ticks.add(now_ns, 1)
        page.handle(json.dumps({"op": "call", "id": 1, "to": OWNER, "command": row.name, "values": values, "text": text,
                                "tick": tick}))
        allowed = has_control or row.is_stop(text, values)
        assert came(box) == [row.name] * allowed, (row.name, text, values)
        page.look()
    browsers.leave(page)
    browsers.close()


@cases(("kind_name", "text", "values", "powers", "authorized"), [
    ("teleop.state_command", "enable", [], True, True), ("teleop.state_command", "align_MTM", [], True, True),
    ("teleop.state_command", "disable", [], False, False), ("console.teleop_enable", "", [1.0], True, True),
    ("console.teleop_enable", "", [0.0], False, False), ("console.select_teleop", "MTMR_PSM1", [], True, True),
    ("arm.state_command", "home", [], True, True), ("arm.state_command", "pause", [], False, False),
    ("arm.move_jp", "", [0.1] * 6, False, True), ("arm.servo_jf", "", [0.0] * 6, False, False),
    ("arm.use_gravity_compensation", "", [1.0], False, False), ("io.tracking_check", "PSM1", [0.0], True, True),
    ("io.tracking_check", "PSM1", [1.0], False, False), ("io.brake_release", "PSM1", [], True, True),
    ("io.brake_engage", "PSM1", [], False, False), ("suj.clutch", "PSM1", [1.0], True, True),
    ("suj.clutch", "PSM1", [0.0], False, False), ("suj.set_lift_velocity", "", [0.0], False, False),
    ("system.home", "", [], True, True), ("system.power_off", "", [], False, False),
    ("teleop.set_scale", "", [0.2], False, True), ("console.emulate_camera", "", [1.0], True, True),
])
def test_these_are_what_people_expect(kind_name: str, text: str, values: list[float], powers: bool, authorized: bool
                                      ) -> None:
    kind, _, name = kind_name.partition(".")
    (row,) = [row for row in COMMANDS[kind] if row.name == name]
    assert is_powerful(row, text, values) is powers and row.needs_operator(text, values) is authorized


def test_a_row_without_its_columns_is_none() -> None:
    with pytest.raises(TypeError):
        CommandRow("set_blinking")  # type: ignore[call-arg]
    for kind, rows in COMMANDS.items():
        for row in rows:
            where = kind, row.name
            assert isinstance(row.effect, Effect) and row.doc and all(each.name for each in row.arguments), where
            assert not row.name.rpartition("/")[2].startswith("servo_j") or row.stream, where
            assert all(cause.partition(".")[0] in COMMANDS for cause in row.causes), where
