"""The wall of a command."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from trocar.procs.document.walls import FRAMES, PARTS, SHAPES, SIDES, SIZES, Wall
from trocar.procs.kinematics.poses import POSE, Array
from trocar.procs.node.requests import CommandRefused

WORDS: Final = (*SIDES, *PARTS, *FRAMES)


def wall_of(text: str, values: Array) -> Wall:
    """The wall of a command; CommandRefused with what is wrong."""
    words = text.split()
    if len(words) < 2 or words[1] not in SHAPES:
        raise CommandRefused(f"a name and a shape are needed first; shapes: {', '.join(SHAPES)}")
    name, shape, *others = words
    if len(unknown := [word for word in others if word not in WORDS]) > 1:
        raise CommandRefused(f"{', '.join(unknown)}: allowed are {', '.join(WORDS)}")
    needed = SIZES[shape]
    if not POSE + needed <= len(values) <= POSE + needed + 1:
        raise CommandRefused(f"a {shape} needs {POSE + needed} numbers, and may have its margin after them")
    size, margin = values[POSE : POSE + needed], values[POSE + needed :]
    wall = Wall(name, shape, tuple(values[:3].tolist()), tuple(values[3:POSE].tolist()), tuple(size.tolist()),
                margin=float(margin[0]) if len(margin) else 0.0)
    for word in others:
        wall = (replace(wall, keep=word) if word in SIDES else replace(wall, of=word) if word in PARTS
                else replace(wall, frame=word))
    return wall
