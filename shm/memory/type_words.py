"""The types of fields that a user's process declares, in words, and their layout in shared memory."""

from __future__ import annotations

from typing import Final

DTYPES: Final = {"float": "<f8", "float32": "<f4", "int": "<i8", "int32": "<i4", "uint8": "u1", "uint16": "<u2",
                 "bool": "?"}


def dtype_of(word: str, shape: tuple[int, ...]) -> str:
    """As a row of the topic table has it; of `text` the shape is its bytes. KeyError: there is no such type."""
    if word == "text":
        return f"S{shape[0] if shape else 1}"
    return f"({','.join(map(str, shape))},){DTYPES[word]}" if shape else DTYPES[word]
