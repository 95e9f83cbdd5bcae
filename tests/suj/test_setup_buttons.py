"""Buttons and commands that release brakes and move the lift: under one rule, without power none counts or waits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.suj.test_edges import QuietCart
from trocar.procs.document.cart import CLASSIC
from trocar.procs.suj.machine import SetupState


def engaged(cart: QuietCart) -> object:
    """Currents of brakes that all hold."""
    return pytest.approx([arm.engaged_current * np.sign(arm.release_current) for arm in cart.cart.arms])


LOSSES: dict[str, Callable[[QuietCart], object]] = {
    "a fault": lambda cart: cart.io.trip(9), "an emergency stop": lambda cart: setattr(cart.io, "has_supply", False),
    "a restart of io": lambda cart: cart.io.restart(), "power-off": lambda cart: cart.ask("state_command", "disable")}


@pytest.mark.parametrize("loss", LOSSES)
def test_a_loss_of_power_ends_what_was_commanded_before_it(enabled: QuietCart, loss: str) -> None:
    enabled.ask("clutch", "PSM1", 1.0)
    enabled.ask("set_lift_velocity", "", 1.0)
    enabled.run(100)
    assert enabled.state_of("clutched")[1] and enabled.state_of("brake_current")[1] and enabled.state_of("lift") == 1.0
    LOSSES[loss](enabled)
    reported = enabled.said("clutch-released")
    for _ in range(3):
        enabled.step()
        reported += enabled.said("clutch-released")
    assert not enabled.state_of("clutched").any() and enabled.state_of("lift") == 0.0
    assert len(reported) == 1 and "PSM1: clutch command ended: power went off; brakes engaged" in reported[0]
    enabled.io.has_supply = True
    enabled.ask("state_command", "home")
    enabled.run(300)
    assert enabled.now_in is SetupState.ENABLED
    assert enabled.state_of("brake_current") == engaged(enabled) and enabled.state_of("lift") == 0.0


def test_what_is_commanded_before_there_is_power_is_refused_and_does_not_wait_for_it() -> None:
    cart = QuietCart(CLASSIC)
    cart.run(10)
    cart.ask("state_command", "home")
    assert cart.now_in is SetupState.POWERING
    for name, text in (("clutch", "PSM1"), ("set_lift_velocity", "")):
        assert cart.ask(name, text, 1.0).outcomes == ["refused"]
    cart.run(300)
    assert cart.now_in is SetupState.ENABLED
    assert not cart.state_of("clutched").any() and cart.state_of("lift") == 0.0


@pytest.mark.parametrize("by", ["a command", "a button"])
def test_without_good_samples_brakes_hold_until_they_are_released_again(enabled: QuietCart, by: str) -> None:
    if by == "a command":
        enabled.ask("clutch", "PSM1", 1.0)
    else:
        enabled.io.pressed.add("SUJ_clutch_3")  # of PSM1's plug
    enabled.run(100)
    assert enabled.state_of("brake_current")[1]
    enabled.io.valid = False
    enabled.run(60)
    assert enabled.now_in is SetupState.ENABLED, "the cause is io's to report"
    assert not enabled.state_of("brake_current").any()
    enabled.io.valid = True
    enabled.run(300)
    assert enabled.state_of("brake_current") == engaged(enabled)
