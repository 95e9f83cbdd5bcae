"""A struct of the native library filled from an object: its numbers, and the addresses of its arrays."""

from __future__ import annotations

import ctypes
import math
import weakref
from collections.abc import Callable
from functools import cache, partial
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.native.fields import CField, CStruct


@cache
def _prototype(given: tuple[str, ...], waits: bool) -> Callable[..., Callable[..., int]]:
    """Prototype of functions with a struct and these numbers: cached, because only garbage collection frees ctypes
    classes.
    """
    more = [{"f8": ctypes.c_double}.get(each, ctypes.c_int64) for each in given]
    return (ctypes.CFUNCTYPE if waits else ctypes.PYFUNCTYPE)(ctypes.c_int64, ctypes.c_void_p, *more)


class BindError(Exception):
    """An array does not match its row."""


class BoundStruct:
    """A struct with the numbers and addresses of one object's arrays, which it keeps alive."""

    def __init__(self, library: ctypes.PyDLL, table: CStruct, source: object) -> None:
        """BindError names the first array that does not match its row."""
        self._library, self._table = library, table
        self._source = weakref.ref(source)  # the source has our functions: loops run without garbage collection
        self._memory = table.ctype()
        self.arrays: dict[str, NDArray[Any]] = {}
        for row in table.fields:
            value = attrgetter(row.source)(source)
            if row.dims:
                self.arrays[row.name] = value
                setattr(self._memory, row.name, self._address(row, value))
            else:
                setattr(self._memory, row.name, value)

    @property
    def address(self) -> int:
        """Address of the C struct."""
        return ctypes.addressof(self._memory)

    def _address(self, row: CField, array: NDArray[Any]) -> int:
        dtype = np.dtype(row.dtype)
        shape = tuple(map(self._number, row.dims))
        where = f"{self._table.name}.{row.name} ({row.source})"
        if array.dtype != dtype or array.shape != shape:
            raise BindError(f"{where} is {array.dtype} {array.shape}, not {dtype} {shape}")
        if not (array.flags.c_contiguous and array.flags.aligned):
            raise BindError(f"{where} does not lie in one piece")
        if row.below and array.size and not 0 <= array.min() <= array.max() < self._size(row.below):
            raise BindError(f"{where} has places beyond {' x '.join(row.below)}")
        return array.ctypes.data

    def _number(self, dim: str) -> int:
        return int(dim) if dim.isdigit() else int(getattr(self._memory, dim))

    def _size(self, dims: tuple[str, ...]) -> int:
        return math.prod(map(self._number, dims))

    def moved(self) -> list[str]:
        """Fields that the source has moved since, or whose number has changed: there must be none."""
        source = self._source()
        now = {row.name: attrgetter(row.source)(source) for row in self._table.fields}
        return [row.name for row in self._table.fields
                if (now[row.name].ctypes.data if row.dims else now[row.name]) != (getattr(self._memory, row.name) or 0)
                and not (row.dims and not now[row.name].size)]

    def function(self, name: str) -> Callable[..., int]:
        """A function of the table, bound to this struct."""
        prototype = _prototype(self._table.functions[name], name in self._table.waiting)
        found = prototype((f"{self._table.name}_{name}", self._library))
        pointer = ctypes.c_void_p(self.address)
        pointer.keeps = self  # type: ignore[attr-defined]  # the function keeps the memory alive
        return partial(found, pointer)
