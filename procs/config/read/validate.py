"""Validates plain values as a frozen model; pydantic's errors and unknown keys become problems with file and line."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import difflib
import re
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final, Literal, TypeVar

from annotated_types import Ge, Gt, Le, Lt, MinLen
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model
from pydantic.fields import FieldInfo

from trocar.procs.config.read.problem import ERROR, WARNING, FileProblem, KeyPath
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document.keys import Key, keys_in
from trocar.procs.fpga.port_name import PortNameError

Item = TypeVar("Item")
ModelType = TypeVar("ModelType", bound=BaseModel)

Rows = Annotated[tuple[Item, ...], Field(strict=False)]  # files hold lists; models hold tuples
MatrixRows = Rows[Rows[float]]
NAME: Final = r"^[A-Za-z0-9_-]{1,40}$"
Name = Annotated[str, Field(pattern=NAME, description="letters, digits, _ and -, at most 40")]


def is_name(text: str) -> bool:
    """Whether a text may be the name of a process."""
    return re.fullmatch(NAME, text) is not None


def _whole_as_text(value: object) -> object:
    """A whole number as text: the original software accepts a version as number or text."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


_SLIP = 0.75  # an unknown key of at least this similarity counts as a typing error
_CALIBRATION = re.compile(  # a word of a name
    r"(?:^|[_-])(?:scales?|scaling|offsets?|gains?|limits?|lower|upper|qmin|qmax|ftmax|max|currents?|tolerances?|distance)"
    r"(?:[_-]|$)", re.IGNORECASE)
_REQUIRED, _UNKNOWN = "this key is required", "unknown key"
_COMMENT = re.compile(r"[_#/]|\$(?:schema|comment)\Z")
_RANGES = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_FORMAT: dict[KeyPath, int] = {("$id",): 0, ("$version",): 1}  # reported first: other formats cause many errors
VersionAsText = BeforeValidator(_whole_as_text)


class Section(BaseModel):
    """A frozen, strict part of a file: no conversions between types, no inf or nan; `validate` reports unknown keys."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore", allow_inf_nan=False, defer_build=True)
    counts_when_empty: ClassVar[bool] = False
    """Whether an empty section differs from an absent one."""
    needs_known_keys: ClassVar[bool] = False
    """Whether an unknown key is an error: a robot that ignores it may be less safe than its file says."""


class SafetySection(Section):
    """A section with a safety meaning: unknown keys in it are errors."""

    needs_known_keys: ClassVar[bool] = True
    instead: ClassVar[Mapping[str, str]] = {}
    """Keys of other versions that are not supported, and what to do instead."""


def keys_of(kind: type) -> Callable[[type[ModelType]], type[ModelType]]:
    """Add the keys declared in the document's `kind` to a section, after its own."""

    def add(model: type[ModelType]) -> type[ModelType]:
        declared = {field.name: _field_of(field, hint, key) for field, hint, key in keys_in(kind)}
        fields: dict[str, Any] = {name: (field.annotation, field) for name, field in declared.items()}
        return create_model(model.__name__, __base__=model, __doc__=model.__doc__, __module__=model.__module__,
                            **fields)

    return add


def _field_of(field: dataclasses.Field[Any], hint: Any, key: Key) -> FieldInfo:
    """A declared key as a pydantic field."""
    hint = typing.get_args(hint)[0]
    default = ... if field.default is dataclasses.MISSING else None if key.is_optional else field.default
    limits: dict[str, Any] = {"gt" if key.above else "ge": key.low, "le": key.high, "pattern": key.pattern or None,
                              "max_length": key.max_length, "description": key.text or None}
    if typing.get_origin(hint) is tuple:
        rows: Any = Rows
        annotated: Any = Annotated
        hint, limits = rows[annotated[typing.get_args(hint)[0], Field(**limits)]], {}
    elif key.is_optional:
        hint = hint | None
    return FieldInfo.from_annotated_attribute(hint, Field(default, alias=key.name or None, **limits))


def validate(
    model: type[ModelType], source: SourceFile, key: KeyPath = (), *, unknown: str = WARNING, in_part: bool = False
) -> tuple[ModelType | None, list[FileProblem]]:
    """Validate the part of `source` at `key`; returns a `model` (None with errors) and all problems.

    `unknown`: severity of unknown keys. `in_part`: if numbers out of range are the only errors, the model is made with
    their defaults, so that the caller finds other problems, too.
    """
    data = source.at(key) if key else source.data
    content: ModelType | None = None
    problems = list(_unknown_keys(model, source, key, data, unknown))
    try:
        content = model.model_validate(_without_empty(model, data))
        return content, _with_format(model, source, key, problems)
    except ValidationError as bad:
        found = sorted(bad.errors(include_url=False), key=lambda error: _FORMAT.get(error["loc"], 2))
        inside = {error["loc"][:cut] for error in found for cut in range(len(error["loc"]))}
        problems += [_problem(model, source, key, error) for error in found
                     if not (error["type"] == "too_short" and error["loc"] in inside)]  # wrong rows are not missing
        if in_part and all(error["type"] in _RANGES for error in found):
            with contextlib.suppress(ValidationError):
                content = model.model_validate(_without(_without_empty(model, data), [row["loc"] for row in found]))
    return content, _with_format(model, source, key, problems)


def _without(data: Any, keys: Sequence[KeyPath]) -> object:
    """A copy of `data` without the values at `keys`; of a list in which one is wrong, without the list."""
    data = copy.deepcopy(data)
    for key in keys:
        while isinstance(key[-1], int):
            key = key[:-1]
        here = data
        for part in key[:-1]:
            here = here[part]
        here.pop(key[-1], None)
    return data


def _with_format(model: type[BaseModel], source: SourceFile, key: KeyPath,
                 problems: list[FileProblem]) -> list[FileProblem]:
    """The problems; first, that a file which need not state its format has the keys of another one."""
    here = (*key, "$id")
    other = any(problem.severity == ERROR and problem.text.startswith((_UNKNOWN, _REQUIRED)) for problem in problems)
    if not other or "$id" not in fields_of(model) or source.at(here) or any(row.key == "$id" for row in problems):
        return problems
    return [_unstated(source, here, _allowed(*_describe_at(model, ("$id",)))), *problems]


def _unstated(source: SourceFile, where: KeyPath, allowed: str) -> FileProblem:
    text = f"{_REQUIRED}: a file without it is from before dVRK 2.4, or of another kind"
    return source.problem(where, text, allowed=f"{allowed}; trocar convert brings old files up to date")


def _without_empty(annotation: Any, data: object) -> object:
    """Remove null, empty lists and empty objects, which are absent for dVRK; keep entries by name even if empty."""
    annotation = unwrapped(annotation)[0]
    if isinstance(data, dict) and _holds_models(annotation):
        inner = typing.get_args(annotation)[1]
        return {name: _without_empty(inner, {} if item is None else item) for name, item in data.items()}
    if isinstance(data, dict):
        known = fields_of(annotation) if _is_model(annotation) else {}
        return {
            name: _without_empty(known[name].annotation if name in known else object, item)
            for name, item in data.items()
            if item not in (None, [], {})
            or (item == {} and name in known and _counts_when_empty(known[name].annotation))
        }
    if isinstance(data, list):
        inner = typing.get_args(annotation)[0] if typing.get_origin(annotation) is tuple else object
        return [_without_empty(inner, item) for item in data]
    return data


def _counts_when_empty(annotation: Any) -> bool:
    return bool(getattr(unwrapped(annotation)[0], "counts_when_empty", False))


def _problem(model: type[BaseModel], source: SourceFile, key: KeyPath, error: Any) -> FileProblem:
    inner: KeyPath = tuple(error["loc"])
    where = (*key, *inner)
    annotation, metadata, description = _describe_at(model, inner)
    allowed = _allowed(annotation, metadata, description)
    kind = str(error["type"])
    if kind == "missing" and inner == ("$id",):
        return _unstated(source, where, allowed)
    if kind == "missing":
        return source.problem(where, _REQUIRED, allowed=allowed)
    while not source.has(where):  # a single text may replace a list of one
        where = where[:-1]
    if kind == "value_error":
        cause = error["ctx"]["error"]
        text, allowed = (cause.what, cause.allowed) if isinstance(cause, PortNameError) else (str(cause), description)
        return source.problem(where, text, allowed=allowed)
    if kind == "finite_number":
        return source.problem(where, "not a finite number", allowed=allowed)
    if kind == "literal_error":
        is_other = inner == ("$id",) and isinstance(error["input"], str)
        return source.problem(where, "another kind of file" if is_other else _unlike(annotation, error["input"]),
                              allowed=allowed)
    if kind.endswith("_type"):
        return source.problem(where, _wrong_type(annotation is str, error["input"]), allowed=allowed)
    return source.problem(where, "not allowed" if kind.startswith("string") else "out of range", allowed=allowed)


def _unlike(annotation: Any, value: object) -> str:
    """The problem of a value that is not among those listed."""
    kinds = {type(listed) for listed in _literals(annotation)}
    if type(value) not in kinds:
        return _wrong_type(kinds == {str}, value)
    return "unknown word" if isinstance(value, str) else "no such value"


def _wrong_type(needs_text: bool, value: object) -> str:
    """The problem of a value of another type; YAML reads 28007 and true as such, not as texts."""
    return "wrong type: put it in quotes" if needs_text and isinstance(value, int | float) else "wrong type"


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


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _holds_models(annotation: Any) -> bool:
    """Whether this is a dict of models by name."""
    return typing.get_origin(annotation) is dict and _is_model(unwrapped(typing.get_args(annotation)[1])[0])


def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields by their names in files."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _describe_at(model: type[BaseModel], inner: KeyPath) -> tuple[Any, list[Any], str]:
    annotation: Any = model
    metadata: list[Any] = []
    description = ""
    for part in inner:
        if isinstance(part, int):
            annotation, metadata, description = unwrapped(typing.get_args(annotation)[0])
        elif _is_model(annotation):
            field = fields_of(annotation).get(part)
            if field is None:
                break
            annotation, metadata, description = unwrapped(field.annotation)
            metadata = metadata + field.metadata
            description = field.description or description
        elif typing.get_origin(annotation) is dict:
            annotation, metadata, description = unwrapped(typing.get_args(annotation)[1])
    return annotation, metadata, description


_PLAIN = {int: "a whole number", float: "a number", bool: "true or false", str: "a text", dict: "an object"}


def _allowed(annotation: Any, metadata: list[Any], description: str) -> str:
    """The allowed values in words."""
    if typing.get_origin(annotation) is Literal:
        words = ", ".join(f'"{value}"' if isinstance(value, str) else str(value) for value in _literals(annotation))
        single = len(_literals(annotation)) == 1
        text = f"the text {words}" if single else f"one of {words}"
    elif _is_model(annotation):
        text = f"an object with {', '.join(fields_of(annotation))}"
    elif typing.get_origin(annotation) is tuple:
        text = "a list"
    elif typing.get_origin(annotation) is dict:
        text = "an object"
    else:
        text = _PLAIN.get(annotation, "a value")
    limits = " ".join(_limit(item) for item in metadata if _limit(item))
    text = f"{text} {limits}" if limits else text
    return f"{text} ({description})" if description else text


def _literals(annotation: Any) -> tuple[Any, ...]:
    return typing.get_args(annotation)


def _limit(item: Any) -> str:
    if isinstance(item, Ge):
        return f"from {item.ge}"
    if isinstance(item, Gt):
        return f"above {item.gt}"
    if isinstance(item, Le):
        return f"up to {item.le}"
    if isinstance(item, Lt):
        return f"below {item.lt}"
    if isinstance(item, MinLen):
        return f"of at least {item.min_length}"
    return ""


def _unknown_keys(annotation: Any, source: SourceFile, key: KeyPath, data: object, severity: str) -> list[FileProblem]:
    annotation = unwrapped(annotation)[0]
    problems: list[FileProblem] = []
    if isinstance(data, list) and typing.get_origin(annotation) is tuple:
        for index, item in enumerate(data):
            problems += _unknown_keys(typing.get_args(annotation)[0], source, (*key, index), item, severity)
    elif isinstance(data, dict) and typing.get_origin(annotation) is dict:
        for name, item in data.items():
            problems += _unknown_keys(typing.get_args(annotation)[1], source, (*key, name), item, severity)
    elif isinstance(data, dict) and _is_model(annotation):
        known = fields_of(annotation)
        severity = ERROR if annotation.needs_known_keys else severity
        for name, item in data.items():
            if name in known:
                problems += _unknown_keys(known[name].annotation, source, (*key, name), item, severity)
            else:
                instead = getattr(annotation, "instead", {}).get(name, "")
                problems.append(source.problem((*key, name), f"not supported: {instead}", allowed=", ".join(known))
                                if instead else _unknown(source, (*key, name), known, severity))
    return problems


def _unknown(source: SourceFile, key: KeyPath, known: Mapping[str, FieldInfo], severity: str) -> FileProblem:
    """The problem of an unknown key: ignored as in the original software, but an error in a `SafetySection`, if it is a
    known key in another spelling, or if it is likely a typing error that would leave a calibration, gain or limit at
    its default. Keys that begin with _, # or / are comments.
    """
    name = str(key[-1])
    allowed = ", ".join(known)
    if _COMMENT.match(name):
        return source.problem(key, "a comment, ignored", allowed=allowed, severity=WARNING)
    folded = {_folded(candidate): candidate for candidate in known}
    nearest = difflib.get_close_matches(_folded(name), folded, n=1, cutoff=0.5)
    meant = folded[nearest[0]] if nearest else ""
    absent = bool(meant) and not source.has((*key[:-1], meant))
    slip = bool(difflib.get_close_matches(_folded(name), nearest, n=1, cutoff=_SLIP))
    unnoticed = absent and slip and not known[meant].is_required() and _calibrates(meant, known[meant])
    if (absent and _folded(name) == _folded(meant)) or severity == ERROR or unnoticed:
        text, severity = _UNKNOWN, ERROR
    else:
        text = f"{_UNKNOWN}, ignored"
    inside = next((inner for inner, field in known.items() if name in _inner(field)), "")
    if inside and not (meant and slip):
        text += f"; it belongs in {inside}"
    elif meant:
        text += f'; did you mean "{meant}"?' + (" Its default would be used unnoticed" if unnoticed else "")
    return source.problem(key, text, allowed=allowed, severity=severity)


def _folded(name: str) -> str:
    """A key as other versions spell it: align-mtm is align_MTM."""
    return name.lower().replace("-", "_")


def _inner(field: FieldInfo) -> Mapping[str, FieldInfo]:
    """The keys of a section that is a value."""
    annotation = unwrapped(field.annotation)[0]
    return fields_of(annotation) if _is_model(annotation) else {}


def _calibrates(name: str, field: FieldInfo) -> bool:
    """Whether a key, or one inside it, is a scale, an offset, a gain or a limit."""
    if _CALIBRATION.search(name):
        return True
    annotation = unwrapped(field.annotation)[0]
    return _is_model(annotation) and any(_calibrates(*item) for item in fields_of(annotation).items())
