"""Decodes plain values of a JSON document into frozen dataclasses, by their type hints alone."""

from __future__ import annotations

import dataclasses
import functools
import types
import typing
from typing import Any, TypeVar

T = TypeVar("T")


def decode(kind: type[T], value: object) -> T:
    """`value` as the dataclass `kind`; if it does not fit, any error that Python raises.

    Values at any depth that already are such dataclasses stay unchanged.
    """
    return typing.cast(T, _decode(kind, value))


@functools.cache
def hints_of(kind: Any) -> dict[str, Any]:
    """Types of the fields of a dataclass."""
    return typing.get_type_hints(kind)


def _decode(kind: Any, value: Any) -> Any:
    if dataclasses.is_dataclass(kind):
        if type(value) is kind:
            return value
        hints = hints_of(typing.cast(Any, kind))
        return kind(**{key: _decode(hints[key], item) for key, item in value.items()})  # type: ignore[operator]  # a dataclass type is callable
    origin = typing.get_origin(kind)
    arguments = typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if value is None:
            return None
        return _decode(next(a for a in arguments if a is not types.NoneType), value)
    if origin is typing.Literal:
        return arguments[arguments.index(value)]
    if origin is tuple:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return tuple(_decode(arguments[0], item) for item in value)
        return tuple(_decode(a, item) for a, item in zip(arguments, value, strict=True))
    return kind(value)
