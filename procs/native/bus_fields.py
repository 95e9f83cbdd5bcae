"""The arrays of a query, a write, and the calls of a cycle: `HubBlocks`, `Groups` and `Exchange` of procs/io/bus."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CStruct, places, rows

HUB: Final = CStruct("Hub", (
    *rows("i8", "", members="members_count", boards="boards_count", columns="columns", buffer="buffer_quads",
          quads="block_quads", mask_of_boards="mask_of_boards", sequence_mask="sequence_mask",
          sequence_shift="sequence_shift"),
    *rows("u1", "22", query="query"),
    # header and status of every board: their places, and their expected values, in wire byte order
    *places("members 2", "buffer", heads="heads"),
    *places("1", "buffer", last_at="last_at"),
    *rows("u4", "1", last="last"),
    *rows("u4", "members 2", check="check", masked="masked", expected="expected"),
    *rows("u4", "members", sizes="sizes"),
    # quadlets from the buffer to the rows of all boards
    *rows("u4", "buffer", received="received"),
    *places("quads", "buffer", taken_from="taken_from"),
    *places("quads", "boards columns", taken_to="taken_to"),
    *rows("u4", "boards columns", blocks="blocks"),
    *rows("b1", "boards", bad="bad", away="away"),
), {"ask": ("i8", "i8", "i8"), "expect": ("i8",), "take": ()})

WRITE: Final = CStruct("Write", (
    *rows("i8", "", boards="boards_count", columns="columns", quads="quads_count", length="length",
          datagram_bytes="datagram_bytes", is_rev_7="is_rev_7"),
    *rows("u4", "boards columns", out="out"),
    *places("quads", "boards columns", packed_from="packed_from"),
    *rows("i8", "quads", packed_to="packed_to"),
    *rows("u4", "boards", board_ids="board_ids"),
    *rows("u1", "datagram_bytes", datagram="datagram_array"),
), {"pack": ()})

UNREADABLE: Final = -1
"""Instead of a size: a datagram came that could not be received."""
NOTHING: Final = -2
"""No datagram has come yet."""

EXCHANGE: Final = CStruct("Exchange", (
    # addresses of the structs of io's halves, of the received and of the sent data
    *rows("i8", "", io="io", hub="hub_address", write="write_address"),
    # the expected reply: its size, that of its data, its sender; and the permitted uses of a sample
    *rows("i8", "", reply_bytes="reply_bytes", data_bytes="data_bytes", hub_node="hub_node", labels="labels",
          head_bytes="head_bytes", oldest_ns="settings.oldest_ns"),
    *rows("f8", "", stable_ns="settings.stable_ns", gaps="settings.gaps"),
    # control word and headers of a write with each label
    *rows("u1", "labels head_bytes", heads="heads"),
    # size and time of the reply, and time of the write
    *rows("i8", "3", came="came"),
), {"receive_and_check": (*["i8"] * 8, "f8"), "control_and_send": ("i8", "i8", "f8", "i8", "i8")})
