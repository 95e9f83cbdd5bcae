"""What one call from the boards' reply to the write that answers it works on, from `Exchange` of io/bus/exchange.py."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CStruct, rows

UNREADABLE: Final = -1
"""In place of a size: something came that could not be received."""
NOTHING: Final = -2
"""Nothing has come yet."""

EXCHANGE: Final = CStruct("Exchange", (
    # addresses of the structs of io's stages, of what is received and of what is sent
    *rows("i8", "", io="io", hub="hub_address", write="write_address"),
    # the wanted reply: its bytes, those of its data, its sender; and what a sample may be used for
    *rows("i8", "", reply_bytes="reply_bytes", data_bytes="data_bytes", hub_node="hub_node", oldest_ns="oldest_ns",
          labels="labels", head_bytes="head_bytes"),
    *rows("f8", "", stable_ns="stable_ns", gaps="gaps"),
    # control word and headers of a write with each label
    *rows("u1", "labels head_bytes", heads="heads"),
    # how many bytes came, and when that was and when the write left
    *rows("i8", "3", came="came"),
), {"answer": ("i8", "i8", "i8", "i8", "i8", "i8", "i8", "i8", "f8")})
