"""The structure of models: where sections and their keys are in annotations; determined once, not for each value."""

from __future__ import annotations

import difflib
import functools
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Final, TypeGuard

from pydantic import BaseModel
from pydantic.fields import FieldInfo

SLIP: Final = 0.75
"""An unknown key of at least this similarity to a known one counts as a typing error."""


def unwrapped(annotation: Any) -> tuple[Any, list[Any], str]:
    """Unwrap Annotated and Optional; returns the bare annotation, the constraints and the description."""
    metadata: list[Any] = []
    description = ""
    while True:
        if typing.get_origin(annotation) is Annotated:
            annotation, *extra = typing.get_args(annotation)
            for item in extra:
                metadata += item.metadata if isinstance(item, FieldInfo) else [item]
                if isinstance(item, FieldInfo) and item.description:
                    description = item.description
        elif typing.get_origin(annotation) in (types.UnionType, typing.Union):
            annotation = next(arg for arg in typing.get_args(annotation) if arg is not types.NoneType)
        else:
            return annotation, metadata, description


def is_model(annotation: Any) -> TypeGuard[type[BaseModel]]:
    """Whether values of this annotation are sections."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


@functools.cache
def fields_of(model: type[BaseModel]) -> Mapping[str, FieldInfo]:
    """The fields by their names in files."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


class Shape:
    """Where sections are in the values of an annotation.

    `rows`: the shape of each element of a list; `named`: of each entry of an object without a model.
    """

    def __init__(self, annotation: Any) -> None:
        bare = unwrapped(annotation)[0]
        origin, inner = typing.get_origin(bare), typing.get_args(bare)
        self.model: type[BaseModel] | None = bare if is_model(bare) else None
        self.rows = _shape_in(inner[0]) if origin is tuple and inner else None
        self.named = _shape_in(inner[1]) if origin is dict else None
        self.counts_when_empty = bool(getattr(self.model, "counts_when_empty", False))

    @functools.cached_property
    def fields(self) -> Mapping[str, Shape]:
        """The shapes of a section's keys."""
        known = fields_of(self.model) if self.model else {}
        return {name: _shape_in(field.annotation) for name, field in known.items()}

    @functools.cached_property
    def has_sections(self) -> bool:
        """Whether keys can be unknown in such a value."""
        return self.model is not None or any(part.has_sections for part in (self.rows, self.named) if part is not None)


@functools.cache
def shape_of(model: type[BaseModel]) -> Shape:
    """The structure of a whole model."""
    return Shape(model)


def _shape_in(annotation: Any) -> Shape:
    bare = unwrapped(annotation)[0]
    return shape_of(bare) if is_model(bare) else Shape(bare)


ANY: Final = Shape(object)
"""Of a value in which nothing is known."""


def meant_by(name: str, known: Iterable[str]) -> tuple[str, bool]:
    """The known key that is most similar to an unknown one, "" for none, and whether that is likely a typing error."""
    names = {folded(candidate): candidate for candidate in known}
    nearest = difflib.get_close_matches(folded(name), names, n=1, cutoff=0.5)
    return (names[nearest[0]] if nearest else "",
            bool(difflib.get_close_matches(folded(name), nearest, n=1, cutoff=SLIP)))


def folded(name: str) -> str:
    """A key as other versions spell it: align-mtm is align_MTM."""
    return name.lower().replace("-", "_")
