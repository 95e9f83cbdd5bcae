"""Both estimates of velocity, and acceleration, of a joint that swings on emulated boards."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.io.boards_harness import rig_of
from trocar.procs.io.robots import ACCELERATION, SOFTWARE_VELOCITY

SWING, HZ, JOINT = 0.2, 0.5, 0


@pytest.mark.slow
def test_both_velocities_and_the_acceleration_follow_the_joint() -> None:
    harness = rig_of("jhu-dVRK/system-PSM1", ())
    harness.bring_up("PSM1")
    arm, record, rows = harness.arms["PSM1"], harness.record, []
    arm.position[:7] = record.setpoint_position
    arm.mode[...] = 1
    start = arm.position[JOINT]
    harness.cycle()
    assert np.isnan(record.software_velocity).all() and np.isnan(record.acceleration).all(), "nobody wants them"
    harness.core.want(SOFTWARE_VELOCITY | ACCELERATION)
    harness.cycle()
    assert np.isnan(record.software_velocity).all() and np.isfinite(record.acceleration).all(), "one sample is too few"
    harness.cycle()
    assert np.isfinite(record.software_velocity).all()
    for k in range(3000):
        arm.position[JOINT] = start + SWING * math.sin(2 * math.pi * HZ * k * harness.period_ns * 1e-9)
        harness.cycle()
        assert np.isfinite(record.software_velocity).all() and np.isfinite(record.acceleration).all()
        rows.append((harness.world.velocity[JOINT], record.firmware_velocity[JOINT], record.software_velocity[JOINT],
                     record.acceleration[JOINT], record.position[JOINT] - start))
    truth, firmware, software, acceleration, position = np.array(rows[500:]).T
    assert np.median(np.abs(firmware - truth)) < 0.01 and np.median(np.abs(software - truth)) < 0.03
    assert np.corrcoef(acceleration, -position)[0, 1] > 0.5
    source = harness.io.robots[0].actuators[JOINT].encoder
    assert source is not None and source.velocity_source == "FIRMWARE"
    np.testing.assert_array_equal(record.velocity, record.firmware_velocity)
    np.testing.assert_allclose(record.pot_bits[JOINT] * 4.5 / 65536, record.pot_voltage[JOINT], rtol=1e-6)
    harness.core.want(0)
    harness.cycle()
    assert np.isnan(record.software_velocity).all() and np.isnan(record.acceleration).all()
