"""Teleoperations that may run side by side: two of one type never share an arm, in any consoles."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from trocar.procs.document.system import SystemConfig

ECM: Final = "ECM"
PSM: Final = "PSM"
PAIR: Final = 2


@dataclass(frozen=True, slots=True)
class Selectable:
    """A teleoperation: its masters are first among its arms."""

    name: str
    console: str
    kind: str
    arms: tuple[str, ...]


def members_of(system: SystemConfig) -> tuple[Selectable, ...]:
    """All of them, console by console, those of the endoscope first."""
    rows = {row.name: Selectable(row.name, row.console, ECM,
                                 (row.mtml, row.mtmr, row.ecm)) for row in system.teleop_ecms}
    rows |= {row.name: Selectable(row.name, row.console, PSM, (row.mtm, row.psm)) for row in system.teleop_psms}
    return tuple(rows[name] for console in system.consoles for name in console.teleops)


def conflicts(member: Selectable, members: Sequence[Selectable]) -> list[Selectable]:
    """Those that cannot be selected together with `member`."""
    return [other for other in members
            if other.name != member.name and other.kind == member.kind and set(other.arms) & set(member.arms)]


def shared_arm(member: Selectable, other: Selectable) -> str:
    """The first arm that both need."""
    return next(arm for arm in member.arms if arm in other.arms)


def at_load(members: Sequence[Selectable]) -> set[str]:
    """Initial selection: each that shares no arm with one before it."""
    chosen: list[Selectable] = []
    for member in members:
        if not conflicts(member, chosen):
            chosen.append(member)
    return {member.name for member in chosen}


def tapped(members: Sequence[Selectable], selected: Collection[str]) -> str:
    """Selection by a quick tap: for the first MTM by name with exactly two PSM teleoperations the other one, or ""."""
    by_master: dict[str, list[Selectable]] = defaultdict(list)
    for member in members:
        if member.kind == PSM:
            by_master[member.arms[0]].append(member)
    pair = next((rows for _, rows in sorted(by_master.items()) if len(rows) == PAIR), None)
    if pair is None:
        return ""
    first, second = pair
    return second.name if first.name in selected else first.name
