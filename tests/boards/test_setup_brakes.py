"""What moves Classic setup joints: hands while their brakes are released, and the lift."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from tests.boards.carts import DISABLE, JOINTS, PLACES, PWM, CartHost, cart, described, with_arms
from tests.boards.rails import Rails
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.setup_joints import LIFT_M_S
from trocar.procs.document.system import SystemConfig
from trocar.procs.fpga import registers as reg


@pytest.fixture(scope="module")
def plain() -> SystemConfig:
    return cart()


@pytest.fixture
def host(plain: SystemConfig) -> CartHost:
    made = CartHost(plain)
    made.reset()
    return made


def is_released(host: CartHost, arm: str) -> bool:
    return bool(host.joints.released[host.joints.arms[arm].plug - 1])


# -- brakes ------------------------------------------------------------------------------------------------------------


def test_brakes_hold_an_arm_until_their_current_lets_it_go(host: CartHost) -> None:
    host.power_on()
    before = host.joints.positions["ECM"]
    with pytest.raises(ValueError, match="ECM: its brakes are engaged"):
        host.joints.place("ECM", PLACES["ECM"])
    assert host.joints.positions["ECM"] == before
    host.current(1, 1.1)
    assert not is_released(host, "ECM"), "not enough"
    host.current(1, 1.5)
    host.joints.place("ECM", PLACES["ECM"])
    assert host.joints.positions["ECM"] == PLACES["ECM"]
    assert [is_released(host, arm) for arm in host.joints.arms] == [True, False, False, False]
    host.current(1, 0.9)
    assert is_released(host, "ECM"), "less keeps it released"
    host.current(1, 0.0)
    with pytest.raises(ValueError, match="brakes are engaged"):
        host.joints.place("ECM", PLACES["ECM"])


def test_brakes_hold_when_power_goes(host: CartHost) -> None:
    host.power_on()
    host.current(3, 2.2)
    assert is_released(host, "PSM2")
    host.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    host.wait(3)
    assert not is_released(host, "PSM2")


def test_the_ramp_of_the_original_releases_and_holds(host: CartHost) -> None:
    host.power_on()
    amps, when = 0.0, []
    for target in (2.2, 0.0):
        while amps != target:
            amps = min(amps + 0.04, target) if target else max(amps - 0.04, target)  # 8 A/s, every 5 ms
            host.current(2, amps)
            host.wait(2)
            when.append((amps, is_released(host, "PSM1")))
    released = [amps for amps, free in when if free]
    assert released[0] == pytest.approx(0.8 * 2.2, abs=0.05) and released[-1] == pytest.approx(0.5 * 2.2, abs=0.05)


def test_the_sign_of_a_brake_current_does_not_matter(plain: SystemConfig) -> None:
    arms = tuple(dataclasses.replace(arm, release_current=-2.2) for arm in described(plain).arms)
    host = CartHost(with_arms(plain, *arms))
    host.power_on()
    host.current(2, -2.2)
    assert is_released(host, "PSM1") and not is_released(host, "PSM2")


def test_brakes_without_a_release_current_always_hold(plain: SystemConfig) -> None:
    joints = described(plain)
    arms = tuple(dataclasses.replace(arm, release_current=0.0) for arm in joints.arms)
    host = CartHost(with_arms(plain, *arms))
    host.power_on()
    for amps in (0.0, 2.2):
        host.current(2, amps)
        assert not is_released(host, "PSM1")


def test_an_order_moves_a_set_up_arm_that_is_let_go(host: CartHost) -> None:
    board_faults = BoardFaults(host.world, Rails(4))
    there = np.array(PLACES["PSM2"])
    with pytest.raises(ValueError, match="brakes are engaged"):
        board_faults.place("SUJ/PSM2", there)
    host.power_on()
    host.current(3, 2.2)
    board_faults.place("SUJ/PSM2", there)
    assert host.joints.positions["PSM2"] == PLACES["PSM2"]
    with pytest.raises(KeyError, match="ECM, PSM1, PSM2, PSM3"):
        board_faults.place("SUJ/PSM4", there)


@pytest.mark.parametrize(("arm", "positions", "error", "says"), [
    ("PSM4", (0.0,) * 6, KeyError, "ECM, PSM1, PSM2, PSM3"),
    ("", (0.0,) * 6, KeyError, "no name: no such setup arm"),
    ("PSM1", (0.0,) * 4, ValueError, "4 positions; allowed: 6 finite numbers"),
    ("PSM1", (0.0, np.nan, 0.0, 0.0, 0.0, 0.0), ValueError, "finite"),
])
def test_wrong_places_are_refused(host: CartHost, arm: str, positions: tuple[float, ...], error: type[Exception],
                                  says: str) -> None:
    with pytest.raises(error, match=says):
        host.joints.place(arm, positions)


def test_positions_beyond_a_potentiometer_end_at_its_rails(host: CartHost) -> None:
    host.joints.settle("PSM1", (5.0, -9.0, 0.0, 0.0, 0.0, 0.0))
    host.sweep()
    assert host.volts[1, 0] == pytest.approx(4.5, abs=1e-3) and host.volts[1, 1] == 0.0


# -- the lift ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def lift(host: CartHost) -> Callable[[], float]:
    """Height of the arm with a lift; its amplifier is powered."""
    host.power_on()
    host.pwm(0.5)
    host.look()
    host.set(DISABLE, False)
    host.wait(2)
    return lambda: host.joints.positions["PSM3"][0]


@pytest.mark.parametrize(("velocity", "sign"), [(1.0, 1), (-1.0, -1), (0.3, 0.3), (0.0, 0)])
def test_the_lift_follows_the_duty_of_its_pwm(
        host: CartHost, lift: Callable[[], float], velocity: float, sign: float) -> None:
    others = {arm: host.joints.positions[arm] for arm in ("ECM", "PSM1", "PSM2")}
    before, rest = lift(), host.joints.positions["PSM3"][1:]
    host.pwm(0.5 + 0.1 * velocity)
    host.wait(2000)
    assert lift() - before == pytest.approx(sign * 2.0 * 0.2 * LIFT_M_S, rel=0.02, abs=1e-9)
    assert host.joints.positions["PSM3"][1:] == rest
    assert others == {arm: host.joints.positions[arm] for arm in others}


def test_the_lift_rests_when_disabled_or_without_supply(host: CartHost, lift: Callable[[], float]) -> None:
    host.pwm(0.6)
    host.wait(10)
    host.look()
    host.set(DISABLE, True)
    host.wait(2)
    before = lift()
    host.wait(500)
    assert lift() == before
    host.look()
    host.set(DISABLE, False)
    host.wait(10)
    assert lift() > before
    host.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    host.wait(2)
    before = lift()
    host.wait(500)
    assert lift() == before


def test_outputs_as_after_power_up_leave_the_lift_alone(host: CartHost) -> None:
    host.power_on()
    before = host.joints.positions["PSM3"]
    host.pwm(0.6)
    host.wait(500)
    assert host.joints.positions["PSM3"] == before


@pytest.mark.parametrize(("duty", "volts"), [(0.95, 4.5), (0.05, 0.0)])
def test_the_lift_stops_where_a_potentiometer_ends(
        host: CartHost, lift: Callable[[], float], duty: float, volts: float) -> None:
    host.pwm(duty)
    host.wait(20_000)
    end = lift()
    host.wait(500)
    assert lift() == end
    host.reset()
    host.sweep()
    away = sorted(abs(host.volts[3, pot] - volts) for pot in (0, JOINTS))
    assert away[0] < 1e-3 and away[1] > 0.1, "the first one that ends"


def test_an_output_that_is_held_drives_the_lift_fully(host: CartHost, lift: Callable[[], float]) -> None:
    before = lift()
    host.one_shot(PWM)
    host.look()
    host.set(PWM, True)
    host.wait(1000)
    up = lift() - before
    host.look()
    host.set(PWM, False)
    host.wait(2000)
    assert up == pytest.approx(LIFT_M_S, rel=0.01) and lift() - before == pytest.approx(-LIFT_M_S, rel=0.02)
