"""A structure shared by Python and C: one table of its fields makes the C struct and the ctypes struct.

A field is a number (no dimensions) or the address of a numpy array. `source` is its name in the Python object that a
`BoundStruct` is made of. Addresses are taken once, so arrays must always be written in place.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from typing import Final

TYPES: Final[dict[str, str]] = {
    "f8": "double", "i8": "int64_t", "u8": "uint64_t", "u4": "uint32_t", "i4": "int32_t", "u2": "uint16_t",
    "u1": "uint8_t", "b1": "uint8_t",
}
"""numpy's name of a type, in the machine's byte order, to C's."""


@dataclass(frozen=True, slots=True)
class CField:
    """One row: a number of type i8 or f8, or an array of `dims`: numbers, or names of i8 fields before it."""

    name: str
    dtype: str
    dims: tuple[str, ...]
    source: str
    below: tuple[str, ...] = ()
    """For an array of indices: the dimensions of the indexed array. C checks no bounds, so binding does."""

    @property
    def declaration(self) -> str:
        """Its declaration in C."""
        star = "*" if self.dims else ""
        size = f"  // ({', '.join(self.dims)})" if self.dims else ""
        return f"  {TYPES[self.dtype]} {star}{self.name};{size}"


def rows(dtype: str, dims: str, **sources: str) -> tuple[CField, ...]:
    """Fields of one type and shape; `dims` are names with a space between, "" for numbers."""
    return tuple(CField(name, dtype, tuple(dims.split()), source) for name, source in sources.items())


def places(dims: str, below: str, **sources: str) -> tuple[CField, ...]:
    """Fields of indices into an array with the dimensions `below`."""
    return tuple(CField(name, "i8", tuple(dims.split()), source, tuple(below.split()))
                 for name, source in sources.items())


@dataclass(frozen=True)
class CStruct:
    """A table, and the native functions that work on it: name to the C types of the arguments after the struct."""

    name: str
    fields: tuple[CField, ...]
    functions: dict[str, tuple[str, ...]]
    waiting: frozenset[str] = frozenset()
    """Those of them that wait: other threads run meanwhile."""

    @property
    def declarations(self) -> str:
        """The struct and its functions, as C declarations."""
        members = "\n".join(field.declaration for field in self.fields)
        heads = [", ".join((f"const {self.name} *k", *(TYPES[t] for t in more))) for more in self.functions.values()]
        functions = [f"int64_t {self.name}_{name}({head});" for name, head in zip(self.functions, heads, strict=True)]
        return f"typedef struct {{\n{members}\n}} {self.name};\n" + "\n".join(functions) + "\n"

    @cached_property
    def ctype(self) -> type[ctypes.Structure]:
        """The struct for ctypes."""
        number = {"f8": ctypes.c_double, "i8": ctypes.c_int64}
        members = [(f.name, ctypes.c_void_p if f.dims else number[f.dtype]) for f in self.fields]
        return type(self.name, (ctypes.Structure,), {"_fields_": members})
