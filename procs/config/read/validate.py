"""Validates plain values as a frozen model; pydantic's errors and unknown keys become problems with file and line."""

from __future__ import annotations

import contextlib
import copy
import re
import typing
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Any, Final, Literal, TypeVar

from annotated_types import Ge, Gt, Le, Lt, MinLen
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from trocar.procs.config.read.problem import ERROR, WARNING, FileProblem, KeyPath, key_text
from trocar.procs.config.read.shapes import ANY, Shape, fields_of, folded, is_model, meant_by, shape_of, unwrapped
from trocar.procs.config.read.source import SourceFile
from trocar.procs.fpga.port_name import PortNameError

ModelType = TypeVar("ModelType", bound=BaseModel)

_CALIBRATION = re.compile(  # a word of a name
    r"(?:^|[_-])(?:scales?|scaling|offsets?|gains?|limits?|lower|upper|qmin|qmax|ftmax|max|currents?|tolerances?|distance)"
    r"(?:[_-]|$)", re.IGNORECASE)
_REQUIRED, _UNKNOWN = "this key is required", "unknown key"
_COMMENT = re.compile(r"[_#/]|\$(?:schema|comment)\Z")
_SCHEMA: KeyPath = ("$schema",)  # names the schema of a file, for editors
_RANGES = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_EMPTY: Final[tuple[Any, ...]] = (None, [], {})
_NESTED = (dict, list)
_FORMAT: dict[KeyPath, int] = {("$id",): 0, ("$version",): 1}  # reported first: other formats cause many errors


def validate(
    model: type[ModelType], source: SourceFile, key: KeyPath = (), *, unknown: str = WARNING, in_part: bool = False
) -> tuple[ModelType | None, list[FileProblem]]:
    """Validate the part of `source` at `key`; returns a `model` (None with errors) and all problems.

    `unknown`: severity of unknown keys. `in_part`: if numbers out of range are the only errors, the model is made with
    their defaults, so that the caller finds other problems, too.
    """
    data = source.at(key) if key else source.data
    content: ModelType | None = None
    shape = shape_of(model)
    filled = _without_empty(shape, data) if isinstance(data, _NESTED) else data
    problems = list(_unknown_keys(shape, source, key, data, unknown))
    try:
        content = model.model_validate(filled)
        return content, _with_format(model, source, key, problems)
    except ValidationError as bad:
        found = sorted(bad.errors(include_url=False), key=lambda error: _FORMAT.get(error["loc"], 2))
        inside = {error["loc"][:cut] for error in found for cut in range(len(error["loc"]))}
        refused = {problem.key for problem in problems if problem.severity == ERROR}
        problems += [_problem(model, source, key, error) for error in found
                     if not (error["type"] == "too_short" and error["loc"] in inside)  # wrong rows are not missing
                     and not _is_misspelt(model, source, (*key, *error["loc"]), refused, error)]
        if in_part and all(error["type"] in _RANGES for error in found):
            with contextlib.suppress(ValidationError):
                content = model.model_validate(_without(filled, [row["loc"] for row in found]))
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


def _without_empty(shape: Shape, data: Any) -> object:
    """Remove null, empty lists and empty objects, which are absent for dVRK; keep entries by name even if empty."""
    if isinstance(data, list):
        inner = shape.rows or ANY
        return [_without_empty(inner, item) if isinstance(item, _NESTED) else item for item in data]
    if shape.named is not None and shape.named.model is not None:
        entries = {name: {} if item is None else item for name, item in data.items()}
        return {name: _without_empty(shape.named, item) if isinstance(item, _NESTED) else item
                for name, item in entries.items()}
    return {
        name: _without_empty(shape.fields.get(name, ANY), item) if isinstance(item, _NESTED) else item
        for name, item in data.items()
        if item not in _EMPTY or (item == {} and name in shape.fields and shape.fields[name].counts_when_empty)
    }


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
        text = "another kind of file" if is_other else _unlike(annotation, error["input"])
        return source.problem(where, text, allowed=allowed)
    if kind.endswith("_type"):
        return source.problem(where, _wrong_type(annotation is str, error["input"]), allowed=allowed)
    return source.problem(where, "not allowed" if kind.startswith("string") else "out of range", allowed=allowed)


def _is_misspelt(model: type[BaseModel], source: SourceFile, where: KeyPath, refused: Container[str],
                 error: Any) -> bool:
    """Whether a required key is only misspelt: an unknown one beside it that means it is `refused` already."""
    beside, owner = source.at(where[:-1]), _describe_at(model, tuple(error["loc"][:-1]))[0]
    return error["type"] == "missing" and isinstance(beside, dict) and is_model(owner) and any(
        meant_by(str(other), fields_of(owner)) == (where[-1], True)
        for other in beside if key_text((*where[:-1], other)) in refused)


def _unlike(annotation: Any, value: object) -> str:
    """The problem of a value that is not among those listed."""
    kinds = {type(listed) for listed in typing.get_args(annotation)}
    if type(value) not in kinds:
        return _wrong_type(kinds == {str}, value)
    return "unknown word" if isinstance(value, str) else "no such value"


def _wrong_type(needs_text: bool, value: object) -> str:
    """The problem of a value of another type; YAML reads 28007 and true as such, not as texts."""
    return "wrong type: put it in quotes" if needs_text and isinstance(value, int | float) else "wrong type"


def _describe_at(model: type[BaseModel], inner: KeyPath) -> tuple[Any, list[Any], str]:
    annotation: Any = model
    metadata: list[Any] = []
    description = ""
    for part in inner:
        if isinstance(part, int):
            annotation, metadata, description = unwrapped(typing.get_args(annotation)[0])
        elif is_model(annotation):
            field = fields_of(annotation).get(part)
            if field is None:
                break
            annotation, metadata, description = unwrapped(field.annotation)
            metadata = metadata + field.metadata
            description = field.description or description
        elif typing.get_origin(annotation) is dict:
            annotation, metadata, description = unwrapped(typing.get_args(annotation)[1])
    return annotation, metadata, description


_LIMITS = ((Ge, "ge", "from"), (Gt, "gt", "above"), (Le, "le", "up to"), (Lt, "lt", "below"),
           (MinLen, "min_length", "of at least"))
_PLAIN = {int: "a whole number", float: "a number", bool: "true or false", str: "a text", dict: "an object"}


def _allowed(annotation: Any, metadata: list[Any], description: str) -> str:
    """The allowed values in words."""
    if typing.get_origin(annotation) is Literal:
        values = typing.get_args(annotation)
        words = ", ".join(f'"{value}"' if isinstance(value, str) else str(value) for value in values)
        text = f"the text {words}" if len(values) == 1 else f"one of {words}"
    elif is_model(annotation):
        text = f"an object with {', '.join(fields_of(annotation))}"
    elif typing.get_origin(annotation) is tuple:
        text = "a list"
    elif typing.get_origin(annotation) is dict:
        text = "an object"
    else:
        text = _PLAIN.get(annotation, "a value")
    limits = [f"{word} {getattr(item, name)}" for item in metadata for kind, name, word in _LIMITS
              if isinstance(item, kind)]
    text = " ".join((text, *limits))
    return f"{text} ({description})" if description else text


def _unknown_keys(shape: Shape, source: SourceFile, key: KeyPath, data: Any, severity: str) -> Iterator[FileProblem]:
    if shape.rows is not None and isinstance(data, list) and shape.rows.has_sections:
        for index, item in enumerate(data):
            yield from _unknown_keys(shape.rows, source, (*key, index), item, severity)
    elif shape.named is not None and isinstance(data, dict) and shape.named.has_sections:
        for name, item in data.items():
            yield from _unknown_keys(shape.named, source, (*key, name), item, severity)
    elif shape.model is not None and isinstance(data, dict):
        known = fields_of(shape.model)
        severity = ERROR if _needs_known_keys(shape.model) else severity
        for name, item in data.items():
            inner = shape.fields.get(name)
            if inner is not None:
                if inner.has_sections:
                    yield from _unknown_keys(inner, source, (*key, name), item, severity)
            elif (*key, name) != _SCHEMA:
                instead = getattr(shape.model, "instead", {}).get(name, "")
                yield (source.problem((*key, name), f"not supported: {instead}", allowed=", ".join(known))
                       if instead else _unknown(source, (*key, name), known, severity))


def _unknown(source: SourceFile, key: KeyPath, known: Mapping[str, FieldInfo], severity: str) -> FileProblem:
    """The problem of an unknown key: ignored as in the original software, but an error in a `SafetySection`, if it is a
    known key in another spelling, or if it is likely a typing error that would leave a calibration, gain or limit at
    its default. Keys that begin with _, # or / are comments.
    """
    name = str(key[-1])
    allowed = ", ".join(known)
    if _COMMENT.match(name):
        return source.problem(key, "a comment, ignored", allowed=allowed, severity=WARNING)
    meant, slip = meant_by(name, known)
    absent = bool(meant) and not source.has((*key[:-1], meant))
    lacking = absent and slip and known[meant].is_required()
    unnoticed = absent and slip and not lacking and _matters(meant, known[meant])
    if lacking or unnoticed or severity == ERROR or (absent and folded(name) == folded(meant)):
        text, severity = _UNKNOWN, ERROR
    else:
        text = f"{_UNKNOWN}, ignored"
    inside = next((inner for inner, field in known.items() if name in _inner(field)), "")
    if inside and not (meant and slip):
        text += f"; it belongs in {inside}"
    elif meant:
        text += f'; did you mean "{meant}"?' + (" Its default would be used unnoticed" if unnoticed else "")
    return source.problem(key, text, allowed=allowed, severity=severity)


def _inner(field: FieldInfo) -> Mapping[str, FieldInfo]:
    """The keys of a section that is a value."""
    annotation = unwrapped(field.annotation)[0]
    return fields_of(annotation) if is_model(annotation) else {}


def _matters(name: str, field: FieldInfo) -> bool:
    """Whether a key, or one inside it, is a scale, an offset, a gain or a limit, or holds a `SafetySection`."""
    if _CALIBRATION.search(name) or _holds_safety(field.annotation):
        return True
    annotation = unwrapped(field.annotation)[0]
    return is_model(annotation) and any(_matters(*item) for item in fields_of(annotation).items())


def _holds_safety(annotation: Any) -> bool:
    annotation = unwrapped(annotation)[0]
    if typing.get_origin(annotation) is dict:  # the section `trocar`, whose keys are checked by themselves
        return True
    if is_model(annotation):
        return _needs_known_keys(annotation)
    return any(map(_holds_safety, typing.get_args(annotation)))


def _needs_known_keys(model: type[BaseModel]) -> bool:
    return bool(getattr(model, "needs_known_keys", False))
