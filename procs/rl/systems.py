"""The systems that environments make for themselves."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import os
from typing import Final

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import LOCKSTEP, SystemConfig
from trocar.procs.rl.backend import BOARDS

PERIOD_S: Final = 0.002
"""Of io, arms and the physics of emulated robots, unless something else is asked for."""
COARSEST_S: Final = 0.002
"""Of the physics of arms on boards: with longer steps the light joints of a wrist ring, and trip."""
FINEST_S: Final = 0.0005
_numbers: Final = itertools.count()


def document(file: str, backend: str, period_s: float, physics_s: float) -> SystemConfig:
    """A system file of ours in simulated time, under a name that nothing else in this process has.

    ValueError for periods that it cannot have.
    """
    if not FINEST_S <= period_s <= COARSEST_S:
        raise ValueError(f"period_s is {period_s:g} s; allowed: {FINEST_S:g} to {COARSEST_S:g} s")
    if not FINEST_S <= physics_s <= COARSEST_S:
        raise ValueError(f"physics_s is {physics_s:g} s; allowed: {FINEST_S:g} to {COARSEST_S:g} s")
    name = f"rl{os.getpid()}x{next(_numbers)}"
    return dataclasses.replace(_loaded(file, backend, period_s, physics_s), name=name)


@functools.lru_cache(maxsize=16)
def _loaded(file: str, backend: str, period_s: float, physics_s: float) -> SystemConfig:
    sets = ["clock=lockstep", f"io.period_s={period_s}", f"arm.period_s={period_s}", "recorder.on=false"]
    if backend == BOARDS:
        sets.append(f"emulation.period_s={physics_s}")
    loaded = load_system(PROJECT_CONFIGS / "systems" / file, name="rl", sets=sets,
                         boards="emulated" if backend == BOARDS else None)
    if loaded.system is None:
        raise ValueError("; ".join(str(error) for error in loaded.errors))
    assert loaded.system.clock == LOCKSTEP
    return loaded.system
