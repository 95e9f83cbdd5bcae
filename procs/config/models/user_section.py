"""Users' code in the `trocar:` section: topics, commands and properties of processes, and in-cycle tasks."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from trocar.procs.config.read.validate import Rows, Section
from trocar.procs.document.user_process import BYTES, TYPE

Word = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,31}$",
                            description="letters, digits and _, not a digit first, at most 32")]
Type = Annotated[str, Field(pattern=TYPE, description=f"{', '.join(BYTES)}; with a length: float[6], text[24]")]


class FieldKeys(Section):
    """A field of a topic, or an argument of a command."""

    name: Word
    type: Type = "float"
    unit: str = Field(default="", max_length=40)
    text: str = Field(default="", max_length=400)


class TopicKeys(Section):
    """A topic of a user's process."""

    name: Word
    rate_hz: float = Field(default=0.0, ge=0.0, le=10000.0, description="Hz as a rule; 0: now and then")
    depth: int = Field(default=256, ge=2, le=65536, description="records that are kept")
    fields: Rows[FieldKeys] = Field(min_length=1)


EffectWord = Literal["read", "setting", "free", "relax", "release", "motion", "power"]


class CommandKeys(Section):
    """A command of a user's process or derived arm."""

    name: Word
    arguments: Rows[FieldKeys] = ()
    text: str = Field(default="", max_length=400)
    effect: EffectWord = Field(default="motion", description="its worst effect, also by commands to others; motion "
                               "and power need an operator's command")
    stops: bool = False
    latest: bool = False


class PropertyKeys(Section):
    """A number or text that can be set at run time."""

    name: Word
    type: Annotated[str, Field(pattern=r"^(float|int|bool|text\[[1-9][0-9]?\])$",
                               description="float, int, bool, or text[24]: at most this many bytes")] = "float"
    default: float | bool | str | None = None
    min: float | None = None
    max: float | None = None
    unit: str = Field(default="", max_length=40)
    text: str = Field(default="", max_length=400)


def _plain(options: dict[str, object]) -> dict[str, object]:
    for name, value in options.items():
        if not _is_plain(value):
            raise ValueError(f"{name} is no plain value")
    return options


def _is_plain(value: object) -> bool:
    """Whether JSON can carry a value to io; pydantic checks fields for inf and nan, but not these values."""
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, dict):
        return all(isinstance(name, str) and _is_plain(item) for name, item in value.items())
    if isinstance(value, float):
        return value - value == 0.0
    return isinstance(value, (bool, int, str))


_OPTIONS = "numbers (no inf, no nan), texts, true, false, lists and objects of these"
Options = Annotated[dict[str, object], AfterValidator(_plain), Field(description=_OPTIONS)]
Maker = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$", description="the name of a class or function")]


class TaskKeys(Section):
    """One task; default for `robots`: all with a joint controller."""

    module: Annotated[str, Field(min_length=1, description="a .py file, or an importable module")]
    name: Maker
    robots: Rows[str] = ()
    budget_us: float = Field(default=50.0, ge=1.0, le=1000.0, description="µs")
    over_budget: int = Field(default=10, ge=1, le=1000, description="cycles in a row")
    options: Options = Field(default_factory=dict, description=_OPTIONS)
