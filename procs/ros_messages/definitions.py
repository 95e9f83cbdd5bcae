"""Message definitions in ROS 2 format (.msg), with all messages they contain: schemas of recordings."""

from __future__ import annotations

from typing import Any, Final

from trocar.procs.ros_messages.hashes import ARRAY, BOOLEAN, NESTED, SEQUENCE, STRING, TYPE_IDS, described
from trocar.procs.ros_messages.idl import IdlStruct

SEPARATOR: Final = "=" * 80
WORDS: Final = {number: word for word, number in TYPE_IDS.items()} | {BOOLEAN: "bool", STRING: "string"}


def definition(message: type[IdlStruct]) -> str:
    """The text of a message and of all messages it contains, one after the other, as MCAP and rosbag2 require."""
    own, parts = described(message)
    texts = [_fields(own)]
    texts += [f"{SEPARATOR}\nMSG: {_short(name)}\n{_fields(parts[name])}" for name in sorted(parts)]
    return "".join(texts)


def _fields(description: dict[str, Any]) -> str:
    return "".join(f"{_word(field['type'])} {field['name']}\n" for field in description["fields"])


def _word(kind: dict[str, Any]) -> str:
    number, many = int(kind["type_id"]), ""
    if number > SEQUENCE:
        number, many = number - SEQUENCE, "[]"
    elif number > ARRAY:
        number, many = number - ARRAY, f"[{kind['capacity']}]"
    if number == NESTED:
        return _short(str(kind["nested_type_name"])) + many
    return (WORDS[number] if number in WORDS else f"string<={kind['string_capacity']}") + many


def _short(name: str) -> str:
    """As definitions name a type: sensor_msgs/JointState."""
    return name.replace("/msg/", "/")

