"""The governor by native code and by numpy: the same setpoints to the bit, whatever is asked for."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from tests.native.shadow import both
from trocar.procs.arm.governor import Governor
from trocar.procs.native.arm_fields import GOVERNOR
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.library import bind, native
from trocar.procs.tables.arm_types import ARM_TYPES

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

NUMBERS = st.floats(-1.0, 1.0) | st.floats() | st.sampled_from((-0.0, math.nan, 1e-320))


@examples(400)
@given(st.sampled_from(sorted(ARM_TYPES)), st.data())
@pytest.mark.slow
def test_both_come_to_the_same_setpoints(name: str, data: st.DataObject) -> None:
    servo = ARM_TYPES[name].servo
    n = len(servo.speed)
    row = st.lists(NUMBERS, min_size=n, max_size=n)
    governor = Governor(
        SimpleNamespace(**{name: np.zeros(n) for name in ("goal", "target", "asked", "velocity", "feed_velocity")}),
        np.array(servo.speed), np.array(servo.acceleration), np.full(n, -0.5), np.full(n, 0.5))
    bound = bind(GOVERNOR, governor)
    assert isinstance(bound, BoundStruct)
    governor.start(np.array(data.draw(st.lists(st.floats(-1.0, 1.0), min_size=n, max_size=n))))
    for _ in range(data.draw(st.integers(1, 6))):
        governor.target[...], governor.feed[...], governor.asked[...] = data.draw(row), data.draw(row), data.draw(row)
        dt, has_feed = data.draw(st.sampled_from((1e-9, 1 / 1500, 0.005))), data.draw(st.booleans())
        both("advance", bound, bound.function("advance"), governor.advance, dt, has_feed, exact=True)
        both("measure", bound, bound.function("measure"), governor.measure, exact=True)
