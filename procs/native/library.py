"""The library of native code in this process, or the reason for its absence: then numpy is used."""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from trocar.procs.native.bound import BindError, BoundStruct
from trocar.procs.native.fields import CStruct
from trocar.procs.native.sources import IN_WHEELS, STRUCTS, library_path, source_hash

SWITCH: Final = "TROCAR_NATIVE"
"""Environment variable: 0: without native code; else the file of the library, for tests."""


@dataclass(frozen=True, slots=True)
class NativeLibrary:
    """The library, None if there is none; `why` then gives the reason."""

    library: ctypes.PyDLL | None
    why: str = ""
    file: Path | None = None


@functools.cache
def native() -> NativeLibrary:
    """The library of this source; found and checked once."""
    wanted = os.environ.get(SWITCH, "")
    if wanted == "0":
        return NativeLibrary(None, f"{SWITCH} is 0")
    places = [Path(wanted)] if wanted else [IN_WHEELS, library_path()]
    there = [path for path in places if path.is_file()]
    if not there:
        return NativeLibrary(None, "it is not compiled; python -m trocar.procs.native.build does it")
    return _checked(there[0])


def _checked(path: Path) -> NativeLibrary:
    try:
        library = ctypes.PyDLL(str(path))
        found = ctypes.c_int64.in_dll(library, "native_hash").value
        sizes = (ctypes.c_int64 * len(STRUCTS)).in_dll(library, "native_sizes")
    except (OSError, ValueError) as error:
        return NativeLibrary(None, f"{path.name} cannot be loaded: {error}")
    if found != source_hash():
        return NativeLibrary(None, f"{path.name} was made from other sources")
    if list(sizes) != [ctypes.sizeof(table.ctype) for table in STRUCTS]:
        return NativeLibrary(None, f"{path.name} has structs of another size")
    return NativeLibrary(library, file=path)


def bind(table: CStruct, source: object) -> BoundStruct | str:
    """The arrays of `source` for the native library's functions; else the reason for a failure."""
    library = native().library
    if library is None:
        return native().why
    try:
        return BoundStruct(library, table, source)
    except BindError as error:
        return str(error)


def address_of(function: Callable[..., int]) -> int:
    """Address of the struct that a `chosen` function works on; 0: it is a method."""
    return int(function.args[0].value) if isinstance(function, functools.partial) else 0


def chosen(table: CStruct, source: object, prefix: str = "") -> tuple[Callable[..., int], ...]:
    """The functions of `table`, in its order, for `source`; else its equivalent methods.

    The methods have the names of the functions with `prefix` before them.
    """
    bound = bind(table, source)
    return tuple(bound.function(name) if isinstance(bound, BoundStruct) else getattr(source, prefix + name)
                 for name in table.functions)
