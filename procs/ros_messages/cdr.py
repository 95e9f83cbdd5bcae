"""Messages as bytes: the common data representation (CDR) of DDS, little-endian, as ROS 2 writes it."""

from __future__ import annotations

import struct
from typing import Any, Final

from trocar.procs.ros_messages.idl import IdlStruct

ENCAPSULATION: Final = b"\0\1\0\0"
NUMBERS: Final = {name: struct.Struct(f"<{letter}") for name, letter in {
    "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "float32": "f", "float64": "d"}.items()}


def packed(message: IdlStruct) -> bytes:
    """A message with its encapsulation header; numbers are aligned to their size."""
    data = bytearray()
    _put(data, type(message), message)
    return ENCAPSULATION + bytes(data)


def _put(data: bytearray, annotation: Any, value: Any) -> None:
    kind = annotation.__metadata__[0] if hasattr(annotation, "__metadata__") else annotation
    if kind is bool:
        data.append(value)
    elif hasattr(kind, "subtype"):
        if not getattr(kind, "length", 0):
            _put(data, "uint32", len(value))
        for element in value:
            _put(data, kind.subtype, element)
    elif kind is str or hasattr(kind, "max_length"):
        text = value.encode() + b"\0"
        _put(data, "uint32", len(text))
        data += text
    elif kind in NUMBERS:
        number = NUMBERS[kind]
        data += bytes(-len(data) % number.size) + number.pack(value)
    else:
        for name, field in kind.__annotations__.items():
            _put(data, field, getattr(value, name))
