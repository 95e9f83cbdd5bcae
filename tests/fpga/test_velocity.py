import numpy as np

from tests.cases import cases
from trocar.procs.fpga import registers
from trocar.procs.fpga.velocity import FirmwareVelocity, SoftwareVelocity

A_UP = registers.EDGE_A_UP << registers.QUARTER_EDGE_SHIFT
B_UP = registers.EDGE_B_UP << registers.QUARTER_EDGE_SHIFT
FORWARD = registers.VELOCITY_DIRECTION
OVERFLOW = registers.VELOCITY_OVERFLOW

CASES = [
    ((49152, 12288, 12288, 0), (4000.0, 0.0, 4000.0)),
    ((49152, 12288, 12800, 1000), (4000.0, 161582.1586, 4084.0785)),
    ((49152, 12288, 12288, 147456), (4000.0, 0.0, 333.3333)),
    ((49152, 11000, 14000, 500), (4000.0, 904776.8063, 4461.5923)),
    ((49152, 1000, 1200, 0), (4000.0, 0.0, 4000.0)),
    ((49152, 2000, 2200, 0), (4000.0, 379408.5636, 4189.7043)),
]


def estimate(period: int, quarter1: int, quarter5: int, running: int) -> tuple[float, float, float]:
    estimator = FirmwareVelocity(1)
    estimator.words[:, 0] = running, period, quarter5, quarter1
    estimator.update()
    acceleration = estimator.accelerations(np.zeros(1))[0]
    return estimator._speed[0] * estimator.sign[0], acceleration, estimator.predicted[0]


@cases(("words", "expected"), CASES)
def test_firmware_words_give_velocity_both_ways(words: tuple[int, ...], expected: tuple[float, ...]) -> None:
    period, quarter1, quarter5, running = words
    forward = estimate(period | FORWARD, quarter1 | FORWARD | A_UP, quarter5 | FORWARD | A_UP, running | FORWARD)
    np.testing.assert_allclose(forward, expected, rtol=0, atol=6e-5)
    np.testing.assert_allclose(estimate(period, quarter1 | A_UP, quarter5 | A_UP, running), np.negative(expected),
                               rtol=0, atol=6e-5)


@cases(("words", "stated"), CASES)
def test_firmware_words_equal_the_formulas_to_the_last_digits(
    words: tuple[int, ...], stated: tuple[float, ...]
) -> None:
    tick, (period, q1, q5, running) = 1 / 49.152e6, words
    v = 4 / (period * tick)
    a = 8 * (q5 - q1) / (period * (period - q1 + q5) * tick**2 * (q5 + q1)) if 1 / q1 <= 0.0005 else 0.0
    most = 1 / (running * tick) if running else np.inf  # one count in the time since
    expected = (v, a, min(v + a * (period * tick / 2 + running * tick), most))
    np.testing.assert_allclose(expected, stated, rtol=0, atol=6e-5)
    found = estimate(period | FORWARD, q1 | FORWARD | A_UP, q5 | FORWARD | A_UP, running | FORWARD)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_overflow_or_reversal_is_no_velocity() -> None:
    q = 12288 | FORWARD | A_UP
    assert estimate(49152 | FORWARD | OVERFLOW, q, q, 0)[::2] == (0.0, 0.0)
    assert estimate(49152 | FORWARD | registers.PERIOD_DIRECTION_CHANGED, q, q, 0)[::2] == (0.0, 0.0)
    powered_up = (registers.PERIOD_POWER_UP, registers.QUARTER_POWER_UP, registers.QUARTER_POWER_UP,
                  registers.RUNNING_POWER_UP)
    assert estimate(*powered_up)[2] == 0.0


def test_acceleration_needs_edges_of_the_same_kind() -> None:
    assert estimate(49152 | FORWARD, 12288 | FORWARD | A_UP, 12800 | FORWARD | B_UP, 0)[1] == 0.0
    assert estimate(49152 | FORWARD, 12288 | FORWARD | A_UP, 12800 | A_UP, 0)[1] == 0.0
    assert estimate(49152, 12288 | FORWARD | A_UP, 12800 | FORWARD | A_UP, 0)[1] == 0.0
    assert estimate(49152 | FORWARD, FORWARD | A_UP, FORWARD | A_UP, 0)[1] == 0.0


def test_prediction_never_changes_sign() -> None:
    late = (49152 | FORWARD, 24000 | FORWARD | A_UP, 2000 | FORWARD | A_UP, 40000)
    velocity, acceleration, predicted = estimate(*late)
    assert velocity > 0 > acceleration
    assert predicted == 0.0


def test_software_velocity_follows_the_table() -> None:
    counts = [0, 0, 1, 1, 1, 4, 4, 3, 1, 1]
    expected = [0, 0, 500, 499.5, 499, 2333.3333333333, 2331, -500, -2000, -1998]
    estimator = SoftwareVelocity(1)
    found = [estimator.update(np.array([c]), np.array([0.0 if i == 0 else 0.001]))[0] for i, c in enumerate(counts)]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_software_velocity_stops_after_a_second() -> None:
    estimator = SoftwareVelocity(1)
    estimator.update(np.array([0]), np.array([0.0]))
    estimator.update(np.array([5]), np.array([0.25]))
    rest = [estimator.update(np.array([5]), np.array([0.25]))[0] for _ in range(6)]
    assert rest[0] > rest[1] > rest[2] > 0
    assert rest[-1] == 0.0


def test_setting_an_encoder_is_no_motion() -> None:
    estimator = SoftwareVelocity(1)
    estimator.update(np.array([0]), np.array([0.0]))
    estimator.reset(np.array([100000]))
    assert estimator.update(np.array([100000]), np.array([0.001]))[0] == 0.0


def test_after_a_long_rest_the_speed_before_is_that_of_the_longest_period() -> None:
    tick, longest, period, q1 = 1 / 49.152e6, registers.VELOCITY_TICKS_MASK, 49152, 12288
    a = 8 * (longest - q1) / (period * longest * tick**2 * (longest + q1))
    q5 = longest | FORWARD | A_UP | OVERFLOW
    np.testing.assert_allclose(estimate(period | FORWARD, q1 | FORWARD | A_UP, q5, 0)[1], a, rtol=1e-9)
