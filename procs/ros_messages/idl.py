"""Types of message fields: those of cyclonedds, or stand-ins where it is missing, so that recordings do not need it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from cyclonedds.idl import IdlStruct as IdlStruct
    from cyclonedds.idl.types import float32 as float32
    from cyclonedds.idl.types import float64 as float64
    from cyclonedds.idl.types import int32 as int32
    from cyclonedds.idl.types import int64 as int64
    from cyclonedds.idl.types import uint8 as uint8
    from cyclonedds.idl.types import uint32 as uint32

    sequence = list
    Octets = bytes
    Name = str
else:
    try:
        from cyclonedds.idl import IdlStruct
        from cyclonedds.idl.types import array, bounded_str, float32, float64, int32, int64, sequence, uint8, uint32
    except ImportError:
        int32, int64, uint8, uint32 = (Annotated[int, name] for name in ("int32", "int64", "uint8", "uint32"))
        float32, float64 = Annotated[float, "float32"], Annotated[float, "float64"]

        class IdlStruct:
            """A message; `typename` as DDS has it."""

            def __init_subclass__(cls, typename: str = "") -> None:
                cls.__idl_typename__ = typename or cls.__idl_typename__

        class sequence:
            """Elements of a type; an `array` has a fixed number of them."""

            def __init__(self, subtype: Any, length: int = 0) -> None:
                self.subtype, self.length = subtype, length

            def __class_getitem__(cls, given: Any) -> Any:
                subtype, length = given if isinstance(given, tuple) else (given, 0)
                return Annotated[Sequence[subtype], cls(subtype, length)]

        array = sequence

        class bounded_str:
            """A text with a largest length."""

            def __init__(self, max_length: int) -> None:
                self.max_length = max_length

            def __class_getitem__(cls, max_length: int) -> Any:
                return Annotated[str, cls(max_length)]

    Octets = array[uint8, 16]
    Name = bounded_str[256]
