"""Sections of files as models: their keys are declared in the section, or at the fields of a class of the document."""

from __future__ import annotations

import dataclasses
import functools
import re
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, create_model
from pydantic.fields import FieldInfo

from trocar.procs.config.read.shapes import unwrapped
from trocar.procs.document.keys import NAME, Key, keys_in

Item = TypeVar("Item")
SectionType = TypeVar("SectionType", bound=BaseModel)

Rows = Annotated[tuple[Item, ...], Field(strict=False)]  # files hold lists; models hold tuples
MatrixRows = Rows[Rows[float]]
Name = Annotated[str, Field(pattern=NAME.pattern, description=NAME.text)]


def is_name(text: str) -> bool:
    """Whether a text may be the name of a process."""
    return re.fullmatch(NAME.pattern, text) is not None


def _whole_as_text(value: object) -> object:
    """A whole number as text: the original software accepts a version as number or text."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


VersionAsText = BeforeValidator(_whole_as_text)


class Section(BaseModel):
    """A frozen, strict part of a file: no conversions between types, no inf or nan; `validate` reports unknown keys."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore", allow_inf_nan=False, defer_build=True)
    counts_when_empty: ClassVar[bool] = False
    """Whether an empty section differs from an absent one."""
    needs_known_keys: ClassVar[bool] = False
    """Whether an unknown key is an error: a robot that ignores it may be less safe than its file says."""
    further_keys_of: ClassVar[type | None] = None
    """The class of the document to whose keys this section adds others, which the document does not have; those inside
    an object are in a section that is the type of its key.
    """


class SafetySection(Section):
    """A section with a safety meaning: unknown keys in it are errors."""

    needs_known_keys: ClassVar[bool] = True
    instead: ClassVar[Mapping[str, str]] = {}
    """Keys of other versions that are not supported, and what to do instead."""


def keys_of(kind: type, of: str = "") -> Callable[[type[SectionType]], type[SectionType]]:
    """Add the keys that the document's `kind` declares for this section (`Key.of`) to it, after its own."""

    def add(model: type[SectionType]) -> type[SectionType]:
        fields: dict[str, Any] = {row[0].name: _field_of(*row) for row in keys_in(kind) if row[2].of == of}
        return create_model(model.__name__, __base__=model, __doc__=model.__doc__, __module__=model.__module__,
                            **fields)

    return add


@functools.cache
def section_of(kind: type, base: type[Section]) -> type[Section]:
    """The section whose keys are the fields of the document's `kind`, with its docstring; schemas show its name."""
    fields: dict[str, Any] = {}
    for field, hint, key in keys_in(kind, whole=True):
        place = fields
        for part in key.inside:
            place = place.setdefault(part, {})
        place[field.name] = _field_of(field, hint, key, base)
    further = next((more for more in base.__subclasses__() if more.further_keys_of is kind), base)
    return _with_objects(kind, kind.__name__.removeprefix("User").removesuffix("Config"), fields, base, further)


def _with_objects(kind: type, name: str, fields: dict[str, Any], base: type[Section],
                  further: type[Section]) -> type[Section]:
    """The section with these fields, in which a dict is an object, optional if all its keys are."""
    for key, inner in fields.items():
        if isinstance(inner, dict):
            own: Any = further.model_fields[key].annotation if key in further.model_fields else base
            made = _with_objects(kind, name + key.title().replace("_", ""), inner, base, own)
            is_required = any(field.is_required() for field in made.model_fields.values())
            fields[key] = made, ... if is_required else made()
    return create_model(f"{name}Keys", __base__=further, __doc__=kind.__doc__, __module__=kind.__module__, **fields)


def _values(keys: Section) -> Iterator[tuple[str, Any]]:
    """All values of a section, those inside its objects, too."""
    for name, value in keys:
        yield from _values(value) if isinstance(value, Section) else ((name, value),)


class _MadeOf:
    """`_MadeOf(Section)[UserTopic]`: values of that class of the document, each made of a section with its fields."""

    def __init__(self, base: type[Section]) -> None:
        self._base = base

    def __getitem__(self, kind: type) -> Any:
        own = {field.name for field in dataclasses.fields(kind)}  # not the further keys of a base
        return Annotated[section_of(kind, self._base), AfterValidator(
            lambda keys: kind(**{name: value for name, value in _values(keys) if name in own}))]


if TYPE_CHECKING:
    Keys: TypeAlias = Annotated[Item, Section]
    SafetyKeys: TypeAlias = Annotated[Item, SafetySection]
else:
    Keys, SafetyKeys = _MadeOf(Section), _MadeOf(SafetySection)


def _field_of(field: dataclasses.Field[Any], hint: Any, key: Key, base: type[Section] = Section) -> Any:
    """A declared key for pydantic: its type and its field."""
    hint = typing.get_args(hint)[0] if typing.get_origin(hint) is Annotated else hint
    hint = Literal[key.choices] if key.choices else hint
    given = key.default if field.default is dataclasses.MISSING else field.default
    is_required = given is ... or key.min_length
    default = ... if is_required else None if key.is_optional else given
    limits: dict[str, Any] = {
        "gt" if key.above else "ge": key.low, "le": key.high, "pattern": key.pattern or None,
        "min_length": key.min_length, "max_length": key.max_length, "description": key.text or None}
    if typing.get_origin(hint) is tuple:
        rows: Any = Rows
        annotated: Any = Annotated
        limits["min_length"] = None
        hint = rows[annotated[_in_files(typing.get_args(hint)[0], base), Field(**limits)]]
        if key.length is not None:
            hint = annotated[hint, AfterValidator(functools.partial(_of_length, key.length))]
        limits = {"min_length": key.min_length, "description": f"{key.length} numbers" if key.length else None}
    else:
        hint = _in_files(hint, base)
        hint = hint | None if key.is_optional else hint
    made = FieldInfo.from_annotated_attribute(hint, Field(default, alias=key.name or None, **limits))
    return made.annotation, made


def _of_length(length: int, values: tuple[float, ...]) -> tuple[float, ...]:
    if len(values) != length:
        raise ValueError(f"{len(values)} numbers")
    return values


def _in_files(hint: Any, base: type[Section]) -> Any:
    """A type of the document; if it is a class of it, or such a class or None, made of a section."""
    bare = unwrapped(hint)[0]
    if not dataclasses.is_dataclass(bare):
        return hint
    made = _MadeOf(base)[typing.cast(type, bare)]
    return made if hint is bare else made | None
