"""A structure that Python and C share: one table of its fields makes the C struct and the ctypes struct.

A field is a number (no dimensions) or the address of an array that numpy has made. `source` names it on the Python
side, from the object that a `BoundStruct` is made of. Addresses are taken once: arrays are written in place for ever.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

TYPES: Final[dict[str, str]] = {
    "f8": "double", "i8": "int64_t", "u8": "uint64_t", "u4": "uint32_t", "i4": "int32_t", "u2": "uint16_t",
    "u1": "uint8_t", "b1": "uint8_t",
}
"""numpy's name of a type, in the machine's byte order, to C's."""


class BindError(Exception):
    """An array is not what its row says."""


@dataclass(frozen=True, slots=True)
class CField:
    """One row: a number of type i8 or f8, or an array of `dims`: numbers, or names of i8 fields before it."""

    name: str
    dtype: str
    dims: tuple[str, ...]
    source: str

    @property
    def declaration(self) -> str:
        """As C writes it."""
        star = "*" if self.dims else ""
        size = f"  // ({', '.join(self.dims)})" if self.dims else ""
        return f"  {TYPES[self.dtype]} {star}{self.name};{size}"


def rows(dtype: str, dims: str, **sources: str) -> tuple[CField, ...]:
    """Fields of one type and shape; `dims` are names with a space between, "" for numbers."""
    return tuple(CField(name, dtype, tuple(dims.split()), source) for name, source in sources.items())


@dataclass(frozen=True)
class CStruct:
    """A table, and the functions of the kernel that work on it: name to the C types of what comes after the struct."""

    name: str
    fields: tuple[CField, ...]
    functions: dict[str, tuple[str, ...]]

    @property
    def declarations(self) -> str:
        """The struct and its functions, as C writes them."""
        members = "\n".join(field.declaration for field in self.fields)
        heads = [", ".join((f"const {self.name} *k", *(TYPES[t] for t in more))) for more in self.functions.values()]
        functions = [f"int64_t {self.name}_{name}({head});" for name, head in zip(self.functions, heads, strict=True)]
        return f"typedef struct {{\n{members}\n}} {self.name};\n" + "\n".join(functions) + "\n"

    @property
    def ctype(self) -> type[ctypes.Structure]:
        """The same for ctypes."""
        number = {"f8": ctypes.c_double, "i8": ctypes.c_int64}
        members = [(f.name, ctypes.c_void_p if f.dims else number[f.dtype]) for f in self.fields]
        return type(self.name, (ctypes.Structure,), {"_fields_": members})


class BoundStruct:
    """A struct filled with the numbers and addresses of one object's arrays, which it keeps."""

    def __init__(self, library: ctypes.PyDLL, table: CStruct, source: object) -> None:
        """BindError names the first array that is not as its row says."""
        self._library, self._table, self._source = library, table, source
        self._memory = table.ctype()
        self.arrays: dict[str, NDArray[Any]] = {}
        for row in table.fields:
            value = attrgetter(row.source)(source)
            if row.dims:
                self.arrays[row.name] = value
                setattr(self._memory, row.name, self._address(row, value))
            else:
                setattr(self._memory, row.name, value)
        self.pointer = ctypes.c_void_p(ctypes.addressof(self._memory))

    def _address(self, row: CField, array: NDArray[Any]) -> int:
        dtype = np.dtype(row.dtype)
        shape = tuple(int(dim) if dim.isdigit() else getattr(self._memory, dim) for dim in row.dims)
        where = f"{self._table.name}.{row.name} ({row.source})"
        if array.dtype != dtype or array.shape != shape:
            raise BindError(f"{where} is {array.dtype} {array.shape}, not {dtype} {shape}")
        if not (array.flags.c_contiguous and array.flags.aligned):
            raise BindError(f"{where} does not lie in one piece")
        return array.ctypes.data

    def moved(self) -> list[str]:
        """Fields that the source has put elsewhere since, or whose number has changed: there must be none."""
        now = {row.name: attrgetter(row.source)(self._source) for row in self._table.fields}
        return [row.name for row in self._table.fields
                if (now[row.name].ctypes.data if row.dims else now[row.name]) != (getattr(self._memory, row.name) or 0)
                and not (row.dims and not now[row.name].size)]

    def function(self, name: str) -> Callable[..., int]:
        """A function of the table, with this struct."""
        more = [{"f8": ctypes.c_double}.get(t, ctypes.c_int64) for t in self._table.functions[name]]
        prototype = ctypes.PYFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, *more)
        found = prototype((f"{self._table.name}_{name}", self._library))
        pointer = self.pointer
        pointer.keeps = self  # type: ignore[attr-defined]  # who has the function has the memory
        return partial(found, pointer)
