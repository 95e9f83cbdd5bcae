"""Remembers the state of a graph of objects and restores it in place, so that all references stay valid.

A walk from some roots finds all mutable state: attributes, slots, containers, arrays, cells of functions, random
generators, native structs, MuJoCo data. Types that cannot be walked must have a row in OPAQUE, with the reason.
Classes and modules are not walked: their own contents are constant.
"""

from __future__ import annotations

import array
import collections
import ctypes
import enum
import functools
import random
import types
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from trocar.shm.memory.segment import Segment

Children = Iterable[tuple[str, object]]
Slots = tuple[tuple[str, types.MemberDescriptorType], ...]

CTYPES_DATA: Final[type] = ctypes.Structure.__mro__[1]
NEVER_CHANGES: Final = (
    type(None), bool, int, float, complex, str, bytes, range, slice, type, enum.Enum, np.generic, np.dtype,
    types.ModuleType, types.CodeType, types.EllipsisType, types.NotImplementedType, types.GetSetDescriptorType,
    types.MemberDescriptorType, types.MethodDescriptorType, types.WrapperDescriptorType)
OPAQUE: Final[Mapping[str, str]] = {
    "builtins.CArgObject": "the address of a struct",
    "builtins.PyCapsule": "memory of MuJoCo, whose arrays are kept",
    "_ctypes.PyCFuncPtr": "functions of the native library and of libc",
    "_io.TextIOWrapper": "logs are no state",
    "_struct.Struct": "never changes",
    "_thread.RLock": "not held while the host does not run",
    "_thread.lock": "not held while the host does not run",
    "logging.Logger": "logs are no state",
    "logging.RootLogger": "logs are no state",
    "mmap.mmap": "segments, which the snapshot keeps as bytes",
    "mujoco._structs.MjModel": "not written once it is assembled",
    "operator.attrgetter": "never changes",
    "operator.itemgetter": "never changes",
    "pathlib.PosixPath": "never changes",
    "re.Pattern": "never changes",
    "weakref.ReferenceType": "never changes",
}
EMPTY: Final = object()
"""Marks an empty cell or slot."""


class UnknownTypeError(TypeError):
    """An object of a type that may change and has no known way to be restored."""


class RememberedObjects:
    """The present mutable state of all objects reachable from `roots`; `put_back` restores it."""

    def __init__(self, roots: Mapping[str, object]) -> None:
        """Remember the state; UnknownTypeError names an object that cannot be restored, with its path."""
        self._kept: dict[int, object] = {}  # so that no id is reused for another object
        self._reached: dict[int, tuple[int, str]] = {}
        self._arrays: list[tuple[NDArray[Any], NDArray[Any]]] = []
        self._bytes: list[tuple[Any, bytes | array.array[Any]]] = []
        self._lists: list[tuple[list[Any], list[Any]]] = []
        self._deques: list[tuple[collections.deque[Any] | set[Any], list[Any]]] = []
        self._mappings: list[tuple[dict[Any, Any], dict[Any, Any]]] = []
        self._attributes: list[tuple[dict[str, Any], dict[str, Any]]] = []
        self._slots: list[tuple[Callable[[Any, Any], None], object, object]] = []
        self._gone: list[tuple[Callable[[Any], None], object]] = []
        self._setters: list[tuple[Callable[[Any], object], object]] = []
        self._data: list[tuple[mujoco.MjData, mujoco.MjModel, mujoco.MjData]] = []
        self.segments: set[str] = set()
        """Names of attached segments; they stay attached, and their content is not kept here."""
        self._walk(roots)
        self._kept.clear()  # the lists have all that is restored
        self._reached.clear()

    def _walk(self, roots: Mapping[str, object]) -> None:
        todo: collections.deque[tuple[object, int, str]] = collections.deque(
            (root, 0, name) for name, root in roots.items())
        while todo:
            one, parent, name = todo.popleft()  # breadth first: the shortest path to each object
            if isinstance(one, NEVER_CHANGES) or id(one) in self._kept:
                continue
            self._kept[id(one)] = one
            self._reached[id(one)] = parent, name
            todo.extend((child, id(one), label) for label, child in self._look_into(one))

    def _look_into(self, one: object) -> Children:
        """Remember the state of an object; returns its children."""
        if _name(type(one)) in OPAQUE:
            return ()
        if isinstance(one, Segment):
            self.segments.add(one.name)
            return ()
        for known, keep in self.KINDS:
            if isinstance(one, known):
                return [*keep(self, one), *self._own(one)]
        kind: Any = type(one)
        if not _is_plain(kind):
            raise UnknownTypeError(f"{self._path(one)} is a {_name(kind)}, and no rule says how it is put "
                                   "back (procs/host/objects.py)")
        return self._own(one)

    def _path(self, one: object) -> str:
        names, number = [], id(one)
        while number:
            number, name = self._reached[number]
            names.append(name)
        return "".join(reversed(names))

    def _own(self, one: object) -> Children:
        """Remember attributes and slots; returns them as children."""
        kind: Any = type(one)
        found: list[tuple[str, object]] = []
        is_frozen = getattr(getattr(kind, "__dataclass_params__", None), "frozen", False)
        own = getattr(one, "__dict__", None) if kind.__dictoffset__ else None
        if own or (own is not None and _is_plain(kind)):  # all functions have a __dict__
            if not is_frozen:
                self._attributes.append((own, dict(own)))
                own.clear()  # rebuild it: after inspection it shares keys with others of its class, and is slow to read
                own.update(self._attributes[-1][1])
            found += [(f".{name}", value) for name, value in own.items()]
        for name, slot in _slots(kind):
            value = _or_empty(slot.__get__, one)
            if value is EMPTY:
                self._gone.append((slot.__delete__, one))
            else:
                found.append((f".{name}", value))
                if not is_frozen:
                    self._slots.append((slot.__set__, one, value))
        return found

    # -- kinds of objects ----------------------------------------------------------------------------------------------

    def _array(self, one: NDArray[Any]) -> Children:
        base = one
        while isinstance(base.base, np.ndarray):
            base = base.base
        if base is not one:
            return (("'s base", base),)
        if one.flags.writeable and not isinstance(one.base, (memoryview, bytearray)):  # otherwise the owner is kept
            self._arrays.append((one, one.copy()))
        return [("'s memory", one.base), *(_numbered(one.flat) if one.dtype.hasobject else ())]

    def _list(self, one: list[Any]) -> Children:
        self._lists.append((one, list(one)))
        return _numbered(one)

    def _deque(self, one: collections.deque[Any] | set[Any]) -> Children:
        self._deques.append((one, list(one)))
        return _numbered(one)

    def _mapping(self, one: dict[Any, Any]) -> Children:
        self._mappings.append((one, dict(one)))
        return _items(one)

    def _flat(self, one: bytearray | array.array[Any]) -> Children:
        self._bytes.append((one, bytes(one) if isinstance(one, bytearray) else one[:]))
        return ()

    def _struct(self, one: Any) -> Children:
        self._setters.append((functools.partial(_write, ctypes.addressof(one)),
                              ctypes.string_at(ctypes.addressof(one), ctypes.sizeof(one))))
        return ()

    def _cell(self, one: types.CellType) -> Children:
        value = _or_empty(getattr, one, "cell_contents")
        if value is EMPTY:
            return ()
        self._setters.append((functools.partial(setattr, one, "cell_contents"), value))
        return ((" (cell)", value),)

    def _function(self, one: types.FunctionType) -> Children:
        cells = zip(one.__code__.co_freevars, one.__closure__ or (), strict=True)
        return [*((f"<{name}>", cell) for name, cell in cells), ("'s defaults", one.__defaults__),
                ("'s defaults", one.__kwdefaults__)]

    def _random(self, one: random.Random) -> Children:
        self._setters.append((one.setstate, one.getstate()))
        return ()

    def _bits(self, one: np.random.BitGenerator) -> Children:
        self._setters.append((functools.partial(setattr, one, "state"), one.state))
        return ()

    def _mujoco(self, one: mujoco.MjData) -> Children:
        copied = mujoco.MjData(one.model)
        mujoco.mj_copyData(copied, one.model, one)
        self._data.append((one, one.model, copied))
        return ()

    KINDS: Final[tuple[tuple[Any, Callable[[RememberedObjects, Any], Children]], ...]] = (
        (np.ndarray, _array), (list, _list), ((collections.deque, set), _deque), (dict, _mapping),
        ((tuple, frozenset), lambda _, one: _numbered(one)), (types.MappingProxyType, lambda _, one: _items(one)),
        ((bytearray, array.array), _flat), (memoryview, lambda _, one: (("'s memory", one.obj),)),
        (CTYPES_DATA, _struct), (types.CellType, _cell), (types.FunctionType, _function),
        ((types.MethodType, types.MethodWrapperType), lambda _, one: (("'s object", one.__self__),)),
        (types.BuiltinFunctionType, lambda _, one: (("'s object", one.__self__),)),
        (functools.partial, lambda _, one: ((".func", one.func), (".args", one.args), (".keywords", one.keywords))),
        (random.Random, _random), (np.random.BitGenerator, _bits),
        (np.random.Generator, lambda _, one: ((".bit_generator", one.bit_generator),)), (mujoco.MjData, _mujoco))

    # -- restoring -----------------------------------------------------------------------------------------------------

    def put_back(self) -> None:
        """Restore the remembered state."""
        for target, values in self._arrays:
            target[...] = values
        for memory, said in self._bytes:
            memory[:] = said
        for own, named in self._attributes:
            own.update(named)
            if len(own) != len(named):
                for name in own.keys() - named.keys():
                    del own[name]
        for mapping, rows in self._mappings:
            mapping.clear()  # restores the order, too
            mapping.update(rows)
        for row, items in self._lists:
            row[:] = items
        for several, items in self._deques:
            several.clear()
            (several.extend if isinstance(several, collections.deque) else several.update)(items)
        for put, one, value in self._slots:
            put(one, value)
        for delete, one in self._gone:
            _or_empty(delete, one)
        for setter, value in self._setters:
            setter(value)
        for data, model, copied in self._data:
            mujoco.mj_copyData(data, model, copied)

    @property
    def counts(self) -> dict[str, int]:
        """Number of remembered items by kind."""
        return {name[1:]: len(value) for name, value in vars(self).items() if isinstance(value, list)}


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _numbered(several: Iterable[object]) -> Children:
    return [(f"[{i}]", one) for i, one in enumerate(several)]


def _items(mapping: Mapping[Any, object]) -> Children:
    return [*((f"[{key!r}]", value) for key, value in mapping.items()), *((".key", key) for key in mapping)]


def _or_empty(ask: Callable[..., object], *given: object) -> object:
    """The value, or EMPTY if there is none."""
    try:
        return ask(*given)
    except (AttributeError, ValueError):
        return EMPTY


def _write(address: int, said: bytes) -> None:
    ctypes.memmove(address, said, len(said))


@functools.cache
def _slots(kind: type) -> Slots:
    """All slots that a class and its bases declare."""
    found = []
    for each in kind.__mro__:
        declared = each.__dict__.get("__slots__", ())
        for name in (declared,) if isinstance(declared, str) else declared:
            own = f"_{each.__name__.lstrip('_')}{name}" if name.startswith("__") and not name.endswith("__") else name
            slot = each.__dict__.get(own)
            if isinstance(slot, types.MemberDescriptorType):
                found.append((own, slot))
    return tuple(found)


@functools.cache
def _is_plain(kind: type) -> bool:
    """Whether objects of this type consist of attributes and slots only, without further C data."""
    words = len(_slots(kind)) + (kind.__weakrefoffset__ > 0) + (kind.__dictoffset__ > 0)
    most = object.__basicsize__ + words * ctypes.sizeof(ctypes.c_void_p)
    return kind.__itemsize__ == 0 and kind.__basicsize__ <= most
