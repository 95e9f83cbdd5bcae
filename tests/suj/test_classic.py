"""Classic setup joints on emulated boards: potentiometers through the multiplexer, brakes, buttons, the lift."""

from __future__ import annotations

import numpy as np
import pytest

from tests.boards.rails import Rails
from tests.suj.cart import PLACES, Cart
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.host.objects import RememberedObjects
from trocar.procs.node.fault_report import reported
from trocar.procs.suj.machine import SetupState

pytestmark = pytest.mark.slow

ROUND_S, WHOLE_S = (16 * (settle + samples) for settle, samples in ((0.005, 2 / 500), (0.03, 60 / 1500)))
CLOSE = 2e-4  # m and rad; half a bit of the converter is 2e-5 m and 1e-4 rad


def placed(made: Cart) -> Cart:
    for name, place in PLACES.items():
        made.plant.settle(name, place)
    return made


@pytest.fixture(scope="module")
def carts() -> tuple[Cart, RememberedObjects, RememberedObjects]:
    """One for all tests, and what puts it back to the start, and to where it is enabled and all arms are known."""
    made = placed(Cart())
    start = RememberedObjects({"cart": made})
    made.enable()
    made.run(4.5 * ROUND_S)
    assert made.valid() == [True] * 4, made.reports.reported
    return made, start, RememberedObjects({"cart": made})


@pytest.fixture
def cart(carts: tuple[Cart, RememberedObjects, RememberedObjects]) -> Cart:
    carts[1].put_back()
    return carts[0]


@pytest.fixture
def known(carts: tuple[Cart, RememberedObjects, RememberedObjects]) -> Cart:
    """Enabled, and all setup arms known."""
    carts[2].put_back()
    return carts[0]


def miss(cart: Cart, name: str, place: tuple[float, ...]) -> float:
    return float(np.abs(cart.field("position")[cart.row(name), :6] - place).max())


def released(cart: Cart) -> list[bool]:
    return [bool(cart.plant.released[cart.plant.arms[name].plug - 1]) for name in PLACES]


def test_three_whole_rounds_at_rest_make_all_arms_known() -> None:
    cart = placed(Cart(quick=False))
    cart.run(3.9 * WHOLE_S)
    assert cart.field("rounds").item() == 3 and cart.valid() == [False] * 4
    cart.run(0.3 * WHOLE_S)
    assert cart.valid() == [True] * 4 and cart.joints.machine.state is SetupState.DISABLED, "brakes hold without power"
    for name, place in PLACES.items():
        assert miss(cart, name, place) < CLOSE
        local = cart.joints._setups.local[cart.row(name)].copy()
        cart.joints._setups.set_joints(cart.row(name), np.array(place))
        assert np.abs(cart.joints._setups.local[cart.row(name)] - local).max() < 1e-3
    assert cart.reports.of("error") == cart.reports.of("warning") == [] and cart.harness.errors() == []


def test_a_clutch_button_lets_one_arm_go_which_is_unknown_then(known: Cart) -> None:
    cart, there = known, (0.5, 0.3, -1.0, 0.2, 0.1, -0.6)
    cart.press("SUJ_clutch_2", True)
    cart.run(0.5)
    assert released(cart) == [False, True, False, False] and cart.valid() == [True, False, True, True]
    assert cart.field("clutched").tolist() == [False, True, False, False]
    assert cart.field("brake_current")[1] == 2.2 and not cart.field("brake_current")[[0, 2, 3]].any()
    cart.plant.place("PSM1", there)
    cart.press("SUJ_clutch_2", False)
    cart.run(0.5)
    assert released(cart) == [False] * 4 and not cart.field("brake_current").any()
    cart.run(1.5 * ROUND_S)
    assert cart.valid() == [True, False, True, True], "not before three whole rounds"
    cart.run(2.6 * ROUND_S)
    assert cart.valid() == [True] * 4
    assert miss(cart, "PSM1", there) < CLOSE and miss(cart, "PSM2", PLACES["PSM2"]) < CLOSE
    assert {"PSM1: clutched", "PSM1: not clutched"} <= set(cart.reports.of("status"))


def test_brakes_follow_a_ramp_of_8_amperes_a_second(known: Cart) -> None:
    known.press("SUJ_clutch_1", True)
    known.run(0.12)  # of which the button's debounce takes 0.1 s
    currents = []
    for _ in range(20):
        known.run(0.01)
        currents.append(float(known.field("brake_current")[0]))
    steps = np.diff(currents)
    assert np.all(steps[np.array(currents[1:]) < 1.5] == pytest.approx(0.08, abs=0.017)) and currents[-1] == 1.5
    measured = known.harness.record.current[0]
    assert measured == pytest.approx(1.5, abs=0.05)


def test_without_power_the_button_moves_no_brake(cart: Cart) -> None:
    cart.press("SUJ_clutch_2", True)
    cart.run(0.6)
    assert released(cart) == [False] * 4 and not cart.field("setup_valid")[1]


def test_brakes_hold_when_the_process_dies_while_clutched(known: Cart) -> None:
    known.press("SUJ_clutch_3", True)
    known.run(0.5)
    assert released(known)[2]
    known.kill()
    known.run(0.05)
    assert not any(released(known)), "30 ms without a setpoint"
    assert known.harness.record.powered[0], "and power stays on"


def test_a_successor_goes_on_without_power_off(known: Cart) -> None:
    known.press("SUJ_clutch_3", True)
    known.run(0.5)
    again = known.restart(0.2)
    again.press("SUJ_clutch_3", False)
    again.run(0.3)
    assert again.joints.machine.state is SetupState.ENABLED and again.joints.machine.is_homed
    assert not any(name == "power_off" for name, _, _ in again.orders.log) and known.harness.record.powered[0]
    assert again.valid() == [False] * 4, "anybody may have moved them"
    again.run(4.2 * ROUND_S)
    assert again.valid() == [True] * 4


def test_lost_power_is_a_fault_and_brakes_hold(known: Cart) -> None:
    known.press("SUJ_clutch_1", True)
    known.run(0.4)
    known.lose_supply(True)
    known.run(0.3)
    assert known.joints.machine.state is SetupState.FAULT and not any(released(known))
    assert known.reports.of("error") and known.reports.states[-1][0] == "FAULT"
    known.press("SUJ_clutch_1", False)
    known.lose_supply(False)
    known.run(0.2)
    known.enable()
    assert known.joints.machine.state is SetupState.ENABLED


def test_potentiometers_that_disagree_make_an_arm_unknown(known: Cart) -> None:
    volts = known.plant._voltages
    good = volts[2, 7]
    volts[2, 7] += np.radians(1.2) / 1.0611  # the second one of joint 2
    known.run(1.2 * ROUND_S)
    assert known.valid() == [True, True, False, True]
    assert known.reports.of("error") == ["PSM2: the potentiometers of joint 2 don't agree; its position is not known"]
    volts[2, 7] = good + np.radians(0.8) / 1.0611
    known.run(2.2 * ROUND_S)
    assert known.valid() == [True] * 4 and "PSM2: the potentiometers agree" in known.reports.of("status")
    assert miss(known, "PSM2", PLACES["PSM2"]) == pytest.approx(np.radians(0.4), abs=2e-4), "the mean of both"


def test_an_arm_that_moves_with_its_brakes_on_is_noticed(known: Cart) -> None:
    before = known.joints._setups.local[0].copy()
    known.plant.settle("ECM", (0.41, -0.295, 0.2, 3.3, 0.0, 0.0))
    known.run(2.1 * ROUND_S)
    assert np.array_equal(known.joints._setups.local[0], before), "noise does not move what an arm stands on"
    known.plant.settle("ECM", (0.41, -0.2, 0.2, 3.3, 0.0, 0.0))
    known.run(2.1 * ROUND_S)
    assert not np.array_equal(known.joints._setups.local[0], before) and known.valid() == [True] * 4
    assert any("without being clutched" in text for text in known.reports.of("warning"))


def test_lost_pulses_are_noticed_and_the_round_begins_anew(known: Cart) -> None:
    rounds = known.field("rounds").item()
    known.orders.lose = "multiplexer"
    known.run(0.3)
    known.orders.lose = ""
    known.run(2.5 * ROUND_S)
    assert known.field("rounds").item() >= rounds + 1 and known.valid() == [True] * 4
    assert any("the multiplexer shows channel" in text for text in known.reports.of("warning"))


@pytest.mark.parametrize("clutched", [False, True])
def test_a_board_that_is_unplugged_is_reported_as_io_reports_it(known: Cart, clutched: bool) -> None:
    if clutched:
        known.press("SUJ_clutch_2", True)
        known.run(0.3)
    BoardFaults(known.harness.world, Rails(4)).take_away(12, True)
    known.run(0.1)
    assert not known.field("brake_current").any(), "brakes hold without samples"
    known.run(1.0)
    (fault,) = [event for event in known.harness.events if event.kind == "error"]
    assert fault.code == "bad-reads" and fault.text.startswith("SUJ, board 12: the controllers sent no valid sample")
    assert known.joints.machine.state is SetupState.FAULT
    assert known.reports.of("error") == [fault.text] == [known.field("reason").item().decode()]
    assert known.reports.faults == [(fault.code, fault.axis, 12, fault.value, fault.limit)]


# -- the lift ----------------------------------------------------------------------------------------------------------


def height(cart: Cart) -> float:
    return float(cart.plant.positions["PSM3"][0])


def test_the_buttons_move_the_lift_and_its_arm_is_unknown(known: Cart) -> None:
    before = height(known)
    known.press("motor_up", True)
    known.run(0.6)
    up = height(known)
    assert up > before + 0.005 and known.valid() == [True, True, True, False] and known.field("lift").item() == 1.0
    known.press("motor_up", False)
    known.run(0.2)
    top = height(known)
    known.run(0.5)
    assert height(known) == top
    known.press("motor_down", True)
    known.run(0.5)
    assert height(known) < top
    known.press("motor_down", False)
    known.run(0.2 + 4.3 * ROUND_S)
    assert known.valid() == [True] * 4 and abs(known.field("position")[3, 0] - height(known)) < CLOSE


def test_the_lift_stops_when_the_process_dies(known: Cart) -> None:
    known.press("motor_up", True)
    known.run(0.5)
    known.kill()
    known.run(0.06)
    stopped = height(known)
    known.run(0.5)
    assert height(known) == stopped
    outputs = [row.name for row in known.harness.io.digital_outputs]
    assert known.harness.record.output[outputs.index("disable_PWM")]


def rests(cart: Cart) -> bool:
    """The lift stands, and its amplifier is disabled."""
    before = height(cart)
    cart.run(0.3)
    outputs = [row.name for row in cart.harness.io.digital_outputs]
    return height(cart) == before and bool(cart.harness.record.output[outputs.index("disable_PWM")])


@pytest.mark.parametrize("at_once", [True, False], ids=["stalled for 31 ms", "killed"])
@pytest.mark.parametrize("by", ["a command", "a button"])
def test_a_lift_that_moves_when_its_process_begins_anew_stops_and_waits_for_an_operator(known: Cart, by: str,
                                                                                       at_once: bool) -> None:
    before = height(known)
    if by == "a button":
        known.press("motor_up", True)
        known.run(0.4)
    else:
        known.say("set_lift_velocity", "", 1.0)
        known.run(0.3)
    assert height(known) > before + 0.003
    again = known.restart(at_once=at_once)
    again.run(0.05)
    assert rests(again) and again.orders.refused == [], "also with its button pressed"
    again.press("motor_up", False)
    again.run(0.3)
    again.press("motor_up", True)
    again.run(0.3)
    assert rests(again) and again.orders.refused == []
    assert [text for text in again.reports.of("warning") if "the lift stays" in text] == [
        "SUJ: the lift stays: the process was restarted, and no operator's command was given since; enable SUJ first"]
    again.press("motor_up", False)
    again.run(0.3)
    before = height(again)
    assert again.say("set_lift_velocity", "", 1.0).outcome == "done"
    again.run(0.3)
    assert height(again) > before + 0.003, "an operator's command moves it"


@pytest.mark.parametrize("lost", ["lift", "all"])
def test_a_lift_whose_stop_is_lost_stops_all_the_same(known: Cart, lost: str) -> None:
    known.say("set_lift_velocity", "", 1.0)
    known.run(0.3)
    known.orders.lose = "lift"
    if lost == "all":
        known.harness.link.loss = 0.5
    known.say("set_lift_velocity", "", 0.0)
    known.run(0.06)
    known.harness.link.loss = 0.0
    assert rests(known)


# -- buttons that are stuck -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("button", ["SUJ_clutch_2", "motor_up"])
def test_a_button_that_is_pressed_when_power_comes_moves_nothing_until_it_was_released(cart: Cart, button: str) -> None:
    cart.run(4.5 * ROUND_S)
    cart.press(button, True)
    cart.run(0.3)
    cart.enable()
    before = height(cart)
    cart.run(1.0)
    assert not any(released(cart)) and height(cart) == before
    warned = [text for text in cart.reports.of("warning") if "is already pressed" in text]
    assert len(warned) == 1 and ("PSM1" if button == "SUJ_clutch_2" else "lift") in warned[0]
    cart.press(button, False)
    cart.run(0.3)
    assert not any(released(cart)) and height(cart) == before
    cart.press(button, True)
    cart.run(0.6)
    assert released(cart)[1] == (button == "SUJ_clutch_2") and (height(cart) > before) == (button == "motor_up")


# -- commands ----------------------------------------------------------------------------------------------------------


def test_a_clutch_command_does_what_the_button_does(known: Cart) -> None:
    for value in (1, 0):
        assert known.say("clutch", "PSM2", value).outcome == "done"
        known.run(0.4)
        assert released(known) == [False, False, bool(value), False]


def test_power_that_does_not_come_is_told(cart: Cart) -> None:
    cart.lose_supply(True)
    request = cart.say("state_command", "enable")
    cart.run(3.5)
    fault = reported(11)
    assert cart.joints.machine.state is SetupState.FAULT and request.outcome == "failed"
    (error,) = cart.reports.of("error")
    assert fault.text in error and request.answers[-1][1] == f"{error}; {fault.code.remedy_for('SUJ')}"
