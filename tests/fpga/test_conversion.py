import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.stock import chain, find
from trocar.procs.fpga import conversion, registers


def _axis(path: str, axis: int) -> dict:
    return json.loads(find(path).read_text())["robots"][0]["actuators"][axis]


CLASSIC = "dvrk-site/jhu-dVRK/sawRobotIO1394-PSM1-28007.json"
SI = "dvrk-site/jhu-daVinci-Si/sawRobotIO1394-PSM1-292409.json"


def _bits(path: str, axis: int, *currents: float) -> list[int]:
    row = _axis(path, axis)["drive"]["current_to_bits"]
    n = len(currents)
    encoder = conversion.CurrentEncoder(np.full(n, row["scale"]), np.full(n, row["offset"]))
    assert encoder.encode(np.array(currents))
    return encoder.bits.tolist()


def test_currents_become_the_bits_of_the_site() -> None:
    assert _bits(CLASSIC, 0, 0.0, 1.0, 1.34, -1.34) == [33032, 27789, 26006, 40057]
    assert _bits(CLASSIC, 2, 0.5) == [35313]
    assert _bits(SI, 0, 0.0, 1.0, -1.0) == [32768, 27968, 37568]


def test_a_negative_offset_wraps_like_the_converter() -> None:
    encoder = conversion.CurrentEncoder(np.array([16000.0]), np.array([-32768.0]))
    encoder.encode(np.array([-0.25]))
    assert encoder.bits.tolist() == [28768]


@pytest.mark.parametrize(
    ("path", "axis", "effort", "limit"),
    [(CLASSIC, 0, 3.3160979998, 1.658), (CLASSIC, 2, 9.8778635928, 0.854), (SI, 0, 17.0849931683, 4.13)])
def test_efforts_and_feedback_limits_of_the_site(path: str, axis: int, effort: float, limit: float) -> None:
    drive = _axis(path, axis)["drive"]
    largest = np.array([drive["maximum_current"]])
    factor = conversion.inverse(np.array([drive["effort_to_current"]["scale"]]))
    np.testing.assert_allclose(largest * factor, effort, rtol=1e-9)
    np.testing.assert_allclose(conversion.feedback_limit(largest), limit, rtol=1e-9)


def test_scales_of_a_site_come_from_its_gears_and_encoders() -> None:
    gears = (56.5, 56.5, 336.6, 11.71, 11.71, 11.71, 11.71)  # the third: 1/m
    counts = (14400, 14400, 14400, 4000, 4000, 4000, 4000)
    constant = _axis(CLASSIC, 0)["drive"]["effort_to_current"]["scale"] * gears[0]  # of the motors, alike on all axes
    for axis, (gear, count) in enumerate(zip(gears, counts, strict=True)):
        row = _axis(CLASSIC, axis)
        np.testing.assert_allclose(abs(row["encoder"]["bits_to_position"]["scale"]), 2 * np.pi / count / gear,
                                   rtol=1e-9)
        np.testing.assert_allclose(row["drive"]["effort_to_current"]["scale"] * gear, constant, rtol=1e-8)
    for path, axes, full in ((CLASSIC, range(7), 6.25), (SI, (0, 1), 65536 / 4800 / 2), (SI, range(2, 7), 2.048)):
        for axis in axes:
            drive = _axis(path, axis)["drive"]
            out, back = drive["current_to_bits"]["scale"], drive["bits_to_current"]["scale"]
            np.testing.assert_allclose(abs(out), 32768 / full, rtol=1e-9)
            np.testing.assert_allclose(back, np.sign(out) * full / 32768, rtol=2e-6)  # the site has rounded it


def test_efforts_of_the_site_are_those_of_the_kinematic_file() -> None:
    np.testing.assert_allclose(chain("PSM").links[0].effort_max, 1.34 / 0.4040893846, rtol=1e-6)


def test_rounding_keeps_every_count_where_truncation_loses_some() -> None:
    scale = np.array([_axis(CLASSIC, 0)["encoder"]["bits_to_position"]["scale"]])
    counts = np.arange(-200000, 200001)
    positions = counts * scale
    preloads = conversion.preload_bits(positions, scale, np.zeros(1))
    assert np.array_equal(preloads - registers.ENCODER_MIDRANGE, counts)
    assert np.count_nonzero(np.trunc(positions / scale).astype(int) != counts) == 1548


def test_preload_of_zero_is_midrange() -> None:
    assert conversion.preload_bits(np.zeros(1), np.array([-1e-5]), np.zeros(1)).tolist() == [0x800000]
    with pytest.raises(ValueError, match="not finite"):
        conversion.preload_bits(np.array([np.nan]), np.array([1e-5]), np.zeros(1))
    with pytest.raises(ValueError, match="range"):
        conversion.preload_bits(np.array([1e5]), np.array([1e-5]), np.zeros(1))


def test_no_motor_means_no_effort() -> None:
    assert conversion.inverse(np.array([0.0, 2.0])).tolist() == [0.0, 0.5]


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_what_is_not_finite_becomes_zero_current(current: float) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        encoder = conversion.CurrentEncoder(np.array([-5242.88]), np.array([33032.44]))
        finite = encoder.encode(np.array([current]))
    assert 0 <= encoder.bits[0] <= 0xFFFF
    if not np.isfinite(current):
        assert not finite
        assert encoder.bits[0] == 33032


def test_watchdog_of_30_ms_is_5760_counts() -> None:
    assert registers.watchdog_counts(0.03) == 5760


@given(
    offset=st.sampled_from((32768.0, 33010.5, 32500.25, -32768.0, -32700.5, 0.0, 65535.0)),
    scale=st.sampled_from((5242.88, -5242.88)),
    asked=st.floats(-1e3, 1e3),
)
def test_bits_within_the_converters_range_never_come_round(offset: float, scale: float, asked: float) -> None:
    scales, offsets = np.array([scale]), np.array([offset])
    least, most = conversion.current_range(scales, offsets)
    current = np.clip(np.array([asked]), least, most)
    encoder = conversion.CurrentEncoder(scales, offsets)
    assert encoder.encode(current)
    turn = np.floor(offset / 65536) * 65536
    assert abs(int(encoder.bits[0]) + turn - (current[0] * scale + offset)) < 1.0


def test_an_axis_without_a_motor_has_no_range() -> None:
    least, most = conversion.current_range(np.zeros(1), np.zeros(1))
    assert least[0] == most[0] == 0.0
