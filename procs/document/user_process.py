"""Users' processes as declared in the system file: topics, commands and properties."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from trocar.procs.document.keys import Key

BYTES: Final = {"float": 8, "float32": 4, "int": 8, "int32": 4, "uint8": 1, "uint16": 2, "bool": 1, "text": 1}
"""Names of types, and the size of an element in bytes."""
TYPE: Final = rf"^({'|'.join(BYTES)})(\[[1-9][0-9]{{0,5}}(,[1-9][0-9]{{0,5}})?\])?$"
WORD: Final = Key(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,31}$",
                  text="letters, digits and _, not a digit first, at most 32")
EffectWord = Literal["read", "setting", "free", "relax", "release", "motion", "power"]
SET_PROPERTY: Final = "set_property"
SAVE_PROPERTIES: Final = "save_properties"
PROPERTIES: Final = "properties"
"""The topic with the present values of the properties."""


@dataclass(frozen=True, slots=True)
class RosPayload:
    """What a ROS message takes from a record: the fields of the same names, and no others.

    `kind` is the CRTK payload (shm/topics.py); empty: its one field is published when it changes. Sizes 0: any number.
    """

    kind: str
    fields: tuple[tuple[str, int], ...]
    types: tuple[str, ...] = ("float", "float32", "int", "int32", "uint8", "uint16")
    is_whole: bool = True
    """All fields are needed; otherwise at least one."""


ROS_PAYLOADS: Final = {
    "sensor_msgs/JointState": RosPayload("js", (("position", 0), ("velocity", 0), ("effort", 0)), is_whole=False),
    "geometry_msgs/PoseStamped": RosPayload("cp", (("pose", 7),)),
    "geometry_msgs/TwistStamped": RosPayload("cv", (("twist", 6),)),
    "geometry_msgs/WrenchStamped": RosPayload("cf", (("wrench", 6),)),
    "geometry_msgs/QuaternionStamped": RosPayload("turn", (("orientation", 4),)),
    "std_msgs/Float64MultiArray": RosPayload("numbers", (("data", 0),)),
    "std_msgs/Float64": RosPayload("", (("data", 1),)),
    "std_msgs/Bool": RosPayload("", (("data", 1),), ("bool",)),
    "std_msgs/String": RosPayload("", (("data", 1),), ("text",)),
}
"""Messages that topics of users' processes may become over ROS."""


@dataclass(frozen=True, slots=True)
class RosTopic:
    """A topic over ROS."""

    message: Annotated[str, Key(pattern=rf"^({'|'.join(ROS_PAYLOADS)})$", text=f"one of {', '.join(ROS_PAYLOADS)}")]
    frame: Annotated[str, Key(max_length=200)] = ""
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class UserField:
    """A field of a topic, or an argument of a command."""

    name: Annotated[str, WORD]
    type: Annotated[str, Key(pattern=TYPE, text=f"{', '.join(BYTES)}; with a length: float[6], text[24]")] = "float"
    unit: Annotated[str, Key(max_length=40)] = ""
    text: Annotated[str, Key(max_length=400)] = ""


@dataclass(frozen=True, slots=True)
class UserTopic:
    """A topic of a user's process."""

    name: Annotated[str, WORD]
    rate_hz: Annotated[float, Key(0.0, 10000.0, "Hz as a rule; 0: now and then")] = 0.0
    depth: Annotated[int, Key(2, 65536, "records that are kept")] = 256
    fields: Annotated[tuple[UserField, ...], Key(min_length=1)] = ()
    ros: Annotated[RosTopic | None, Key(text="the message that the ROS bridge publishes of it")] = None


@dataclass(frozen=True, slots=True)
class UserCommand:
    """A command of a user's process or derived arm."""

    name: Annotated[str, WORD]
    arguments: tuple[UserField, ...] = ()
    text: Annotated[str, Key(max_length=400)] = ""
    # As in shm/mailbox/command_row.py; from "relax" on it needs an operator's command, whose origin is passed on.
    effect: Annotated[EffectWord, Key(
        text="its worst effect, also by commands to others; motion and power need an operator's command")] = "motion"
    stops: bool = False  # it ends something
    latest: bool = False  # of several waiting ones only the newest is executed


@dataclass(frozen=True, slots=True)
class Property:
    """A value that can be read and set at run time; `type` is float, int, bool, or text: `text[24]` has 24 bytes."""

    name: str
    type: str
    default: float = 0.0
    lower: float | None = None
    upper: float | None = None
    unit: str = ""
    text: str = ""
    words: str = ""  # the default of a text

    @property
    def first(self) -> float | str:
        """Its value until it is set."""
        return self.words if self.is_text else self.default

    @property
    def is_text(self) -> bool:
        """Whether it is a text, not a number."""
        return self.type.startswith("text")

    def objection(self, value: float | str) -> str:
        """Why it cannot have this value; empty if it can."""
        if isinstance(value, str) or self.is_text:
            if not (isinstance(value, str) and self.is_text):
                return f"{self.name}: {value!r} is no {self.type}"
            most = size_of(self.type)
            is_fit = len(value.encode()) <= most and value.isprintable()
            return "" if is_fit else f"{self.name}: {value!r} is not printable, or longer than {most} bytes"
        if not math.isfinite(value) or (self.type != "float" and value != int(value)):
            return f"{self.name}: {value:g} is no {self.type}"
        lower, upper = (0.0, 1.0) if self.type == "bool" else (self.lower, self.upper)
        if (lower is not None and value < lower) or (upper is not None and value > upper):
            above = f"from {lower:g}" if lower is not None else ""
            below = f"up to {upper:g}" if upper is not None else ""
            return f"{self.name}: {value:g} is out of range; allowed are {above} {below} {self.unit}".rstrip()
        return ""


@dataclass(frozen=True, slots=True)
class UserProcess:
    """One user's process; `module` is the path of a .py file, or the name of an installed module.

    `host`: the process that calls its update together with others; "" for a process of its own.
    """

    name: str
    module: str
    period_s: float
    topics: tuple[UserTopic, ...] = ()
    commands: tuple[UserCommand, ...] = ()
    properties: tuple[Property, ...] = ()
    host: str = ""


def shape_of(word: str) -> tuple[str, tuple[int, ...]]:
    """The element type and the shape; ValueError when `word` is not a type."""
    match = re.match(TYPE, word)
    if match is None:
        raise ValueError(f"{word!r} is no type")
    return match[1], tuple(int(n) for n in match[2][1:-1].split(",")) if match[2] else ()


def size_of(word: str) -> int:
    """Size of a type in bytes."""
    bare, shape = shape_of(word)
    return BYTES[bare] * math.prod(shape)
