"""Whatever stands in a field of a record: all who read records answer, and no page or verb ends in a traceback."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

import orjson
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from typer.testing import CliRunner

from tests.examples import examples
from tests.tools.wild import Field, WildSystem
from trocar.procs.crtk.topics import EVENT, RECORD
from trocar.procs.crtk.views import OpenTopic
from trocar.procs.foxglove.channels import ShownTopic
from trocar.procs.gui.catalogue import sources_of
from trocar.procs.ros_bridge.outgoing import EVENT_MESSAGES, FIELD_TOPICS, OF_EVENT, OF_FIELD
from trocar.procs.ros_messages.packed_view import PackedView
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES
from trocar.procs.socket_bridge.topics import SharedTopic, Topics
from trocar.tools import cli
from trocar.tools.monitor.values import ValuesData

APP: Final = cli.build()
RECORDING, NEW, AS = "RECORDING", "NEW", "AS"
"""In words: a recording of the system, a file or folder that is not there yet, the name of another system."""
OF_A_SYSTEM: Final[tuple[tuple[str, ...], ...]] = (
    ("status",), ("status", "--json"), ("logs", "--commands"), ("logs", "--commands", "--json"), ("list",),
    ("list", "--verbose"),
    ("hz", "--window", "0.05"), ("attach", "--once"), ("attach", "--json"), ("send", "PSM1"), ("get", "recorder"),
    ("pid", "show", "PSM1"), ("pid", "show", "PSM1", "--json"), ("recordings",),
    ("scope", "PSM1/state.position", "--before", "1"),
    ("scope", "PSM1/state.position", "--when", "fault PSM1 or PSM1/state.position[0] > 0.1", "--past"))
OF_A_TOPIC: Final[tuple[tuple[str, ...], ...]] = ((), ("--json",), ("--csv", "-"))
OF_A_RECORDING: Final[tuple[tuple[str, ...], ...]] = (
    ("logs", "--recording", RECORDING), ("logs", "--recording", RECORDING, "--commands"),
    ("logs", "--recording", RECORDING, "--commands", "--json"), ("compare", RECORDING, RECORDING),
    ("compare", RECORDING, RECORDING, "--json"), ("scope", "PSM1/state.position", "--recording", RECORDING),
    ("export", RECORDING, "--topics", "PSM1/state", "-o", "-"), ("export", RECORDING, "--format", "rosbag2", "-o", NEW),
    ("export", RECORDING, "--format", "parquet", "-o", NEW), ("replay", RECORDING, "--as", AS, "--speed", "100"))
STARTS, DRIVES, NO_RECORD = "starts or ends processes", "only sends commands", "reads no record of a system"
EXCEPTED: Final = {
    **dict.fromkeys(("demo", "up", "down", "start", "stop", "restart", "commission", "rl rollout"), STARTS),
    **dict.fromkeys(("power-on", "home", "power-off", "set", "stream", "pid set"), DRIVES),
    **dict.fromkeys(("bus scan", "bus read", "bus write", "bus watch", "check", "new-arm", "kinematics fk",
                     "kinematics jacobian", "kinematics ik", "kinematics gravity", "convert", "doctor",
                     "bench"), NO_RECORD),
    "record": "asks the recorder to write; what it writes is what `dump` does",
    "pid save": "checks the file that it has written before it keeps it (tests/tools/test_pid.py)"}
"""Verbs that are not tried here, and why."""
PATTERNS: Final = st.lists(st.integers(0, 7), min_size=31, max_size=31)
"""Which value each field has, one after the other and again from the beginning; 0: the good one."""


@pytest.fixture(scope="module")
def wild(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WildSystem]:
    """See there."""
    made = WildSystem(tmp_path_factory.mktemp("wild"), f"t{os.getpid()}x-wild")
    yield made
    made.close()


def spread(fields: Sequence[Field], pattern: Sequence[int]) -> dict[Field, int]:
    """A value for each field that is not to have its good one."""
    return {field: number - 1 for k, field in enumerate(fields) if (number := pattern[k % len(pattern)])}


def no_number(word: str) -> NoReturn:
    raise AssertionError(f"{word} is not JSON")


def answered(words: Sequence[str]) -> str:
    """What a verb prints. It may say that something is wrong, but it does not break."""
    result = CliRunner().invoke(APP, words)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (0, 1), result.output
    if "--json" in words:
        for line in result.stdout.splitlines():
            json.loads(line, parse_constant=no_number)
    return result.output


@pytest.fixture(scope="module")
def topics(wild: WildSystem) -> Iterator[Topics]:
    """All topics of it, as a bridge has them."""
    made = Topics(wild.name)
    yield made
    made.close()


@pytest.fixture(scope="module")
def readers(wild: WildSystem, topics: Topics) -> Iterator[list[Callable[[], None]]]:
    """All that makes something of the newest record of a topic: bridges, pages, echo and attach."""
    made: list[Callable[[], None]] = []
    opened: list[Any] = []
    for entry in topics.entries.values():
        source = OpenTopic(wild.name, entry)
        opened.append(source)
        made.append(reading(source))
        if entry.kind != EVENT:
            opened.append(ValuesData(wild.name, entry))
            made.append(opened[-1].look)
    pages = sources_of(wild.document)
    names = list(pages._makers)
    pages.change([], names)
    made += [showing(pages, name) for name in names]
    yield made
    pages.close()
    for part in opened:
        part.close()


def reading(source: OpenTopic) -> Callable[[], None]:
    """As bridges do."""
    entry = source.entry
    shown, shared = ShownTopic(source, str), SharedTopic.__new__(SharedTopic)
    shared.topic, shared.entry, shared.users, shared.sequence, shared._begin, shared._turn = source, entry, 0, 0, "", 0
    packed = PackedView(source, str) if entry.kind in VIEW_MESSAGES else None
    told = [row for row in FIELD_TOPICS if entry.kind == RECORD and row.field in source._fields]

    def look() -> None:
        if not source.newest():
            return
        shown._message(1)
        shared.look(shared._turn + 1)
        if shared.sequence:
            json.loads(shared.message(0), parse_constant=no_number)
        if packed is not None:
            packed.pack(1)
        for row in told:
            if not source._fields[row.field].shape:
                OF_FIELD[row.message](source._fields[row.field])
        if entry.event in EVENT_MESSAGES:
            OF_EVENT[EVENT_MESSAGES[entry.event]]({name: cell[()] for name, cell in source._fields.items()})

    return look


def showing(pages: Any, name: str) -> Callable[[], None]:
    """As the web console does."""
    return lambda: orjson.loads(b"{" + pages.part(name) + b"}") and None


def test_every_verb_is_tried_or_excepted() -> None:
    verbs = {(verb.name, *part) for verb in cli.VERBS for part in ([(each.name,) for each in verb.parts] or [()])}
    rows = {*OF_A_SYSTEM, *OF_A_RECORDING, ("echo",), ("dump",), ("report",)}
    tried, excepted = {words[:n] for words in rows for n in (1, 2)} & verbs, {tuple(name.split()) for name in EXCEPTED}
    assert verbs == tried | excepted and not tried & excepted, verbs ^ (tried | excepted)


@pytest.mark.slow
@examples(12, suppress_health_check=list(HealthCheck))
@given(pattern=PATTERNS)
def test_bridges_and_pages_show_any_value(wild: WildSystem, readers: list[Callable[[], None]],
                                          pattern: list[int]) -> None:
    wild.write(spread(wild.fields, pattern))
    for read in readers:
        read()


@pytest.mark.slow
@examples(60, suppress_health_check=list(HealthCheck))
@given(pattern=PATTERNS, data=st.data())
def test_verbs_print_any_value(wild: WildSystem, topics: Topics, pattern: list[int], data: st.DataObject) -> None:
    wild.beat()
    wild.write(spread(wild.fields, pattern))
    echoes = [("echo", name, "--once", "--timeout", "0", *more) for name in topics.entries for more in OF_A_TOPIC]
    words = data.draw(st.sampled_from([*OF_A_SYSTEM, *OF_A_SYSTEM, *echoes]))
    answered([*words, "--system", wild.name])


@pytest.mark.slow
def test_recordings_of_any_value_are_read(wild: WildSystem, tmp_path: Path) -> None:
    chance = random.Random(7)  # a single example of hypothesis has only the good values
    for _ in range(8):
        wild.write(spread(wild.fields, chance.choices(range(8), k=31)))
    meant = {RECORDING: f"{tmp_path}/wild.mcap", AS: f"{wild.name}-again"}
    answered(["dump", meant[RECORDING], "--system", wild.name])
    answered(["report", f"{tmp_path}/wild.tar.gz", "--system", wild.name])
    for k, words in enumerate(OF_A_RECORDING):
        meant[NEW] = f"{tmp_path}/{k}"
        answered([meant.get(word, word) for word in words])
