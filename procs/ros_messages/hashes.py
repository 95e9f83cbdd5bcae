"""Names and hashes (REP 2011, RIHS01) by which ROS 2 knows message types, made from the classes in messages.py."""

from __future__ import annotations

import hashlib
import json
from typing import Any, Final

from trocar.procs.ros_messages.idl import IdlStruct

NESTED: Final = 1
TYPE_IDS: Final = {"uint8": 3, "int32": 6, "uint32": 7, "int64": 8, "float32": 10, "float64": 11}
BOOLEAN, STRING, BOUNDED_STRING = 15, 17, 21
ARRAY, SEQUENCE = 48, 144
"""Added to the type number for arrays and sequences."""


def ros_name(message: type[IdlStruct]) -> str:
    """As ROS writes it: sensor_msgs/msg/JointState."""
    package, kind, _, name = str(message.__idl_typename__).split(".")
    return f"{package}/{kind}/{name.removesuffix('_')}"


def dds_name(message: type[IdlStruct]) -> str:
    """As DDS has it: sensor_msgs::msg::dds_::JointState_."""
    return str(message.__idl_typename__).replace(".", "::")


def type_hash(message: type[IdlStruct]) -> str:
    """RIHS01 of a message: the hash of its description and of all types it contains."""
    own, parts = described(message)
    text = {"type_description": own, "referenced_type_descriptions": [parts[name] for name in sorted(parts)]}
    return "RIHS01_" + hashlib.sha256(json.dumps(text).encode()).hexdigest()


def described(message: type[IdlStruct]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The description of a message, and those of all types it contains, by name."""
    parts: dict[str, dict[str, Any]] = {}
    return _description(message, parts), parts


def _description(message: type[IdlStruct], parts: dict[str, dict[str, Any]]) -> dict[str, Any]:
    fields = [{"name": name, "type": _type(annotation, parts)} for name, annotation in message.__annotations__.items()]
    return {"type_name": ros_name(message), "fields": fields}


def _type(annotation: Any, parts: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The description of a field's type; the types it contains are added to `parts`."""
    kind = annotation.__metadata__[0] if hasattr(annotation, "__metadata__") else annotation
    if hasattr(kind, "subtype"):
        found = _type(kind.subtype, parts)
        capacity = int(getattr(kind, "length", 0))
        return found | {"type_id": found["type_id"] + (ARRAY if capacity else SEQUENCE), "capacity": capacity}
    if hasattr(kind, "max_length"):
        return {"type_id": BOUNDED_STRING, "capacity": 0, "string_capacity": kind.max_length, "nested_type_name": ""}
    nested, number = "", BOOLEAN if kind is bool else STRING if kind is str else TYPE_IDS.get(kind, NESTED)
    if number == NESTED:
        nested = ros_name(kind)
        if nested not in parts:
            parts[nested] = _description(kind, parts)
    return {"type_id": number, "capacity": 0, "string_capacity": 0, "nested_type_name": nested}
