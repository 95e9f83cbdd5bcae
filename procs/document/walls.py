"""Walls in the document: where an arm may not go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from trocar.procs.document.keys import Key

PLANE, BOX, SPHERE, CYLINDER, CONE, CAPSULE = SHAPES = ("plane", "box", "sphere", "cylinder", "cone", "capsule")
SIZES: Final = {PLANE: 0, BOX: 3, SPHERE: 1, CYLINDER: 2, CONE: 1, CAPSULE: 2}
"""Numbers of the size of each shape."""
ARMS: Final = "arms"
"""The shape of other arms: shaft, wrist and jaw of each as capsules."""
TIP, JAW, SHAFT, INSTRUMENT = PARTS = ("tip", "jaw", "shaft", "instrument")
OUT, IN = SIDES = ("out", "in")
BASE, REFERENCE = FRAMES = ("base", "reference")
OFF, HOLD = UNKNOWN = ("off", "hold")
AT_WALL: Final = "at wall "  # before its name, in the answer to a goal of a stream
FARTHEST, WIDEST = 10.0, 0.1  # m: of places and sizes, of margins
NAMED: Final = r"^[A-Za-z0-9_-]{1,24}$"
_FRAME_TEXT: Final = "base, reference, or the name of a PSM or ECM: the frame of its tip"


@dataclass(frozen=True, slots=True)
class Wall:
    """One shape that a part of an arm keeps out of, or in.

    `size`: box: its three edges; sphere: its radius; cylinder and capsule: radius and length; cone: half of its angle.
    Of a wall of an arm with the shape ARMS, `arms` are the others.
    """

    name: Annotated[str, Key(pattern=NAMED, text="letters, digits, _ and -, at most 24",
                             min_length=1)]
    shape: Annotated[str, Key(choices=(*SHAPES, ARMS), min_length=1)]
    position: Annotated[tuple[float, ...], Key(-FARTHEST, FARTHEST, "m: of the middle; of a plane, any point of it; of "
                                               "a cone, its apex; of a capsule, one end", length=3)] = (0.0, 0.0, 0.0)
    orientation: Annotated[tuple[float, ...], Key(-1.0, 1.0, "quaternion x y z w; a plane is solid below its z, z is "
                                                  "the axis of cylinder, cone and capsule", length=4)] = (0.0, 0.0,
                                                                                                          0.0, 1.0)
    size: Annotated[tuple[float, ...], Key(0.0, FARTHEST, "m; cone: rad", above=True)] = ()
    keep: Annotated[str, Key(choices=SIDES)] = OUT
    of: Annotated[str, Key(choices=PARTS)] = INSTRUMENT
    frame: Annotated[str, Key(text=_FRAME_TEXT)] = BASE
    margin: Annotated[float, Key(0.0, WIDEST, "m of distance that is kept besides")] = 0.0
    unknown: Annotated[str, Key(choices=UNKNOWN, text="while it is unknown where the wall is: the wall is off, or the "
                                                      "setpoints do not move")] = OFF
    arms: Annotated[tuple[str, ...], Key(text="names of PSMs, ECMs and MTMs; none: all PSMs. Shape arms: those that "
                                              "keep away from each other")] = ()
