"""Processes of users' own in the system file: what they become, and mistakes told with their place."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.document import system as document
from trocar.procs.document.user_process import BYTES
from trocar.shm.memory.rows import DTYPES, dtype_of


@pytest.fixture
def beside(home: Home) -> Path:
    file = home.path / "systems/mine.py"
    file.write_text("raise SystemExit('nobody runs this here')\n")
    return file


def declare(home: Home, *rows: str) -> int:
    """The demo with these processes; returns the line of the first."""
    lines = "".join(f"\n    - {row}" for row in rows)
    return home.edit(SYSTEM, "boards: emulated", f"boards: emulated\n  processes:{lines}") + 2


def test_a_process_is_what_its_row_declares(home: Home, beside: Path) -> None:
    declare(home, "{name: mine, module: mine.py, period_s: 0.02, restart_limit: 1, "
                  "commands: [{name: go, effect: power}], "
                  "topics: [{name: depth, fields: [{name: x, unit: m}]}], properties: [{name: gain, max: 2}]}",
            "{name: PSM1, cpu: 1}")
    loaded = home.load()
    assert loaded.errors == () and loaded.system is not None
    mine = loaded.system.user("mine")
    assert mine is not None and mine.module == str(beside) and mine.commands[0].effect == "power"
    assert mine.topics[0].fields[0].type == "float" and mine.properties[0].upper == 2
    assert loaded.system.process("mine").restart_limit == 1 and loaded.system.process("PSM1").cpus == (1,)
    assert loaded.system.process("mine").kind == "user" and loaded.system.process("mine").period_s == 0.02
    assert document.from_json(document.to_json(loaded.system)) == loaded.system


def test_those_of_a_host_share_its_process_and_period(home: Home, beside: Path) -> None:
    declare(home, "{name: mine, module: mine.py, host: lab}", "{name: lab, period_s: 0.002, cpu: 1}",
            "{name: other, module: mine.py, host: lab}")
    loaded = home.load()
    assert loaded.errors == () and loaded.system is not None
    kinds = {row.name: (row.kind, row.start, row.period_s) for row in loaded.system.processes}
    assert kinds["lab"] == ("filters", "always", 0.002)
    assert kinds["mine"] == kinds["other"] == ("user", "elsewhere", 0.002)


@pytest.mark.parametrize(("row", "key", "text", "allowed"), [
    ("{name: mine, module: mine.py, host: lab, period_s: 0.1}", ".mine.period_s", "lab calls its update", "at lab"),
    ("{name: mine, module: mine.py, host: supervisor}", ".mine.host", "something else has this name", "a unique name"),
    ("{name: mine, module: mine.py, host: PSM1}", ".PSM1", "taken", "a unique name"),
    ("{name: a b, module: mine.py}", ".a b", "'a b' is no name of a process", "letters, digits, _ and -, at most 40"),
    ("{module: mine.py}", "[0]", "a row without a name", "rows with name"),
    ("{name: mine, module: yours.py}", ".mine.module", "no such file", "systems"),
    ("{name: mine, module: mine.py, topic: []}", ".mine.topic", 'did you mean "topics"', "commands"),
    ("{name: mine, topics: [{name: a, fields: [{name: x}]}]}", ".mine", "", ""),
    ("{name: mine, module: mine.py, priority: 50}", ".mine.priority", "normal scheduling", "0"),
    ("{name: PSM1, module: mine.py}", ".PSM1", "taken by a process of Trocar", "a unique name"),
    ("{name: mine, module: mine.py, topics: [{name: events, fields: [{name: x}]}]}", ".mine.topics[0].name",
     "this name is taken", "none of audit"),
    ("{name: mine, module: mine.py, topics: [{name: a, fields: [{name: x, type: double}]}]}",
     ".mine.topics[0].fields[0].type", "not allowed", "float[6]"),
    ("{name: mine, module: mine.py, topics: [{name: a, fields: [{name: x, type: 'float[999999]'}]}]}",
     ".mine.topics[0]", "a record of 7999992 bytes", "at most"),
    ("{name: mine, module: mine.py, commands: [{name: go, arguments: [{name: q, type: 'float[65]'}]}]}",
     ".mine.commands[0]", "65 numbers", "64 numbers"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: Wrench}, fields: [{name: wrench}]}]}",
     ".mine.topics[0].ros.message", "not allowed", "geometry_msgs/WrenchStamped"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: geometry_msgs/WrenchStamped}, "
     "fields: [{name: force, type: 'float[3]'}]}]}", ".mine.topics[0].ros.message",
     "geometry_msgs/WrenchStamped lacks its fields", "wrench (float[6])"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: geometry_msgs/PoseStamped}, "
     "fields: [{name: pose, type: 'float[6]'}]}]}", ".mine.topics[0].fields[0].type",
     "float[6] does not fit geometry_msgs/PoseStamped", "pose (float[7])"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: std_msgs/Bool}, fields: [{name: data}]}]}",
     ".mine.topics[0].fields[0].type", "float does not fit std_msgs/Bool", "data (bool)"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: std_msgs/Float64}, "
     "fields: [{name: data, type: 'float[1]'}]}]}", ".mine.topics[0].fields[0].type", "float[1] does not fit", "data"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: sensor_msgs/JointState, joints: [x, y]}, "
     "fields: [{name: position, type: 'float[3]'}]}]}", ".mine.topics[0].ros",
     "unequal numbers of elements: joints 2, position 3", "equal numbers"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: std_msgs/String, frame: x}, "
     "fields: [{name: data, type: 'text[9]'}]}]}", ".mine.topics[0].ros.frame", "has no frame", "no frame"),
    ("{name: mine, module: mine.py, topics: [{name: a, ros: {message: geometry_msgs/TwistStamped, joints: [a]}, "
     "fields: [{name: twist, type: 'float[6]'}]}]}", ".mine.topics[0].ros", "joints 1, twist 6", "equal numbers"),
    ("{name: mine, module: mine.py, listen: 'localhost:80'}", ".mine.listen", "not an address with a port",
     "127.0.0.1:8080"),
    ("{name: mine, module: mine.py, listen: ['127.0.0.1:1', '127.0.0.1:1']}", ".mine.listen", "mine listens at",
     "an unused one"),
    ("{name: PSM1, listen: '127.0.0.1:80'}", ".PSM1.listen", "it accepts no connections", "no address"),
    ("{name: mine, module: mine.py, properties: [{name: site, type: 'text[4]', default: right}]}",
     ".mine.properties[0].default", "longer than 4 bytes", "a value of its type"),
    ("{name: mine, module: mine.py, properties: [{name: site, type: 'text[60]'}]}", ".mine.properties[0].type",
     "too long a text", "text[59]: 64 bytes with its name"),
    ("{name: mine, module: mine.py, properties: [{name: gain, default: much}]}", ".mine.properties[0].default",
     "'much' is no float", "a value of its type"),
    ("{name: mine, module: mine.py, properties: [{name: gain, default: 3, max: 2}]}", ".mine.properties[0].default",
     "3 is out of range", "within its bounds"),
])
def test_mistake_is_named_with_its_place(home: Home, beside: Path, row: str, key: str, text: str, allowed: str) -> None:
    line = declare(home, row)
    loaded = home.load()
    assert loaded.system is None
    problem = loaded.errors[0]
    assert problem.key.startswith(f"trocar.processes{key}") and problem.line in (line - 1, line)
    assert text in problem.text and allowed in problem.allowed


def test_every_type_has_its_layout() -> None:
    assert set(BYTES) == {*DTYPES, "text"}
    assert dtype_of("float", (6,)) == "(6,)<f8" and dtype_of("text", (24,)) == "S24" and dtype_of("bool", ()) == "?"


def test_who_listens_starts_for_whoever_connects_unless_it_is_said(home: Home, beside: Path) -> None:
    declare(home, "{name: mine, module: mine.py, listen: '127.0.0.1:8080'}",
            "{name: other, module: mine.py, start: always, listen: ['127.0.0.1:8081', '[::1]:8081']}")
    loaded = home.load()
    assert loaded.errors == () and loaded.system is not None
    mine, other = map(loaded.system.process, ("mine", "other"))
    assert (mine.start, mine.listen) == ("on-demand", ("127.0.0.1:8080",))
    assert (other.start, len(other.listen)) == ("always", 2)


def test_time_is_real_where_nobody_is_there_to_simulate_it(home: Home, beside: Path) -> None:
    loaded = home.load_made({"trocar": {"processes": {"mine": {"module": "systems/mine.py"}}}})
    assert loaded.system is not None and loaded.system.clock == "wall"
