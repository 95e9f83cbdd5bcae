"""The governor by native code and by numpy: the same setpoints to the bit, whatever is asked for."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from tests.native.shadow import StructMemory, both
from trocar.procs.arm.governor import Governor
from trocar.procs.native.arm_fields import GOVERNOR
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.library import bind, native
from trocar.procs.tables.arm_types import ARM_TYPES

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

ODD = np.array((-0.0, math.nan, math.inf, -math.inf, 1e-320))
LIMIT = 0.5


def numbers(rng: np.random.Generator, n: int) -> np.ndarray:
    """Within the limits and at them, beyond them, or any floating-point numbers at all."""
    some = rng.uniform(-1.0, 1.0, n)
    anything = rng.integers(0, 1 << 64, n, dtype=np.uint64).view(np.float64)
    mixed = np.choose(rng.integers(0, 3, n), (some, anything, rng.choice(ODD, n)))
    return (some, some.clip(-LIMIT, LIMIT), mixed)[rng.integers(3)]


@examples(120)
@given(st.sampled_from(sorted(ARM_TYPES)), st.integers(0, 2**32 - 1))
@pytest.mark.slow
def test_both_come_to_the_same_setpoints(name: str, seed: int) -> None:
    servo, rng = ARM_TYPES[name].servo, np.random.default_rng(seed)
    n = len(servo.speed)
    governor = Governor(
        SimpleNamespace(**{name: np.zeros(n) for name in ("goal", "target", "asked", "velocity", "feed_velocity")}),
        np.array(servo.speed), np.array(servo.acceleration), np.full(n, -LIMIT), np.full(n, LIMIT))
    bound = bind(GOVERNOR, governor)
    assert isinstance(bound, BoundStruct)
    memory = StructMemory(bound)
    governor.start(rng.uniform(-1.0, 1.0, n))
    for _ in range(6):
        for array in (governor.target, governor.feed, governor.asked):
            array[...] = numbers(rng, n)
        dt, has_feed = float(rng.choice((1e-9, 1 / 1500, 0.005))), bool(rng.integers(2))
        both("advance", memory, bound.function("advance"), governor.advance, dt, has_feed, exact=True)
        both("measure", memory, bound.function("measure"), governor.measure, exact=True)
