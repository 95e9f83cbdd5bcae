"""Joint names in commands: numbers with names are put in the order of the joints."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from trocar.procs.crtk.views import OpenTopic

OUTER: Final = "outer_"
"""Prefix that dvrk_model has, or had, for joints of an arm: outer_yaw is yaw, for PSMs and MTMs alike."""


class WrongNames(ValueError):
    """Names that do not say which number is for which joint."""


@lru_cache(256)
def order_of(names: tuple[str, ...], joints: tuple[str, ...]) -> tuple[int, ...] | None:
    """The index in `names` of each of `joints`; None: in order, as without names. WrongNames lists the known ones.

    A joint is known by its name, with or without `outer_`, and by its number, as cisst names joints.
    """
    if not names:
        return None
    known: dict[str, int] = {}
    for joint, name in enumerate(joints):
        short = name.removeprefix(OUTER)
        known |= {str(joint): joint, short: joint, f"{OUTER}{short}": joint}
    known |= {name: joint for joint, name in enumerate(joints)}
    missing, asked = set(joints), [known.get(name, -1) for name in names]
    if -1 in asked:
        raise _wrong(f"no joint {names[asked.index(-1)]}", joints)
    for joint in asked:
        if joints[joint] not in missing:
            raise _wrong(f"joint {joints[joint]} is named twice", joints)
        missing.discard(joints[joint])
    if missing:
        raise _wrong(f"joint {next(name for name in joints if name in missing)} is not named", joints)
    order = tuple(map(asked.index, range(len(joints))))
    return None if order == tuple(range(len(joints))) else order


def _wrong(reason: str, joints: Sequence[str]) -> WrongNames:
    return WrongNames(f"{reason}; its joints are: {', '.join(joints) or 'not known yet'}")


def in_order(numbers: Sequence[float], names: Sequence[str], joints: tuple[str, ...]) -> Sequence[float]:
    """The numbers, one for each name, in the order of `joints`; WrongNames if the names do not fit, see `order_of`."""
    order = order_of(tuple(names), joints)
    if names and len(numbers) != len(names):
        raise _wrong(f"{len(names)} names and {len(numbers)} numbers", joints)
    return numbers if order is None else [numbers[place] for place in order]


class JointNames:
    """The present joint names of a view, as `PSM1/measured_js`: an instrument brings joints of its own."""

    def __init__(self, source: OpenTopic) -> None:
        self._source, self._names = source, tuple(source.entry.joint_names)
        self._is_fixed, self._raw = bool(self._names), b""

    def now(self) -> tuple[str, ...]:
        """Those of the newest record; none before the first one."""
        if not self._is_fixed and self._source.newest():
            raw = self._source.part("name").tobytes()
            if raw != self._raw:
                self._raw, self._names = raw, tuple(self._source.labels())
        return self._names
