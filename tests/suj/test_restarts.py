"""Setup joints whose process is killed, or stalled for 31 ms, in every state: what the new one orders is accepted."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.suj.fake_cart import MS
from tests.suj.test_edges import QuietCart
from trocar.procs.document.cart import CLASSIC, FIXED, SI
from trocar.procs.suj.machine import SetupState
from trocar.procs.suj.si import EmulatedBoards

BUTTON = "SUJ_clutch_3"  # of PSM1's plug
AWAY_MS = {"stalled for 31 ms": 31, "killed": 500}


def disabled(cart: QuietCart) -> None:
    cart.run(20)


def powering(cart: QuietCart) -> None:
    cart.io.has_supply = False
    cart.ask("state_command", "enable")
    assert cart.kind != CLASSIC or cart.now_in is SetupState.POWERING


def almost_enabled(cart: QuietCart) -> None:
    """Amplifiers are on, and io does not take the currents of the brakes yet."""
    cart.ask("state_command", "enable")
    cart.io.deaf = True
    cart.run(80)
    assert cart.io.flags["amps_on"] and not cart.io.flags["pid_enabled"]
    cart.io.deaf = False


def enabled(cart: QuietCart) -> None:
    cart.ask("state_command", "home")
    cart.run(100)
    assert cart.now_in is SetupState.ENABLED, cart.log


def clutched_by_button(cart: QuietCart) -> None:
    enabled(cart)
    cart.io.pressed.add(BUTTON)
    cart.pressed[1] = True
    cart.run(50)
    assert cart.state_of("clutched")[1]


def clutched_by_command(cart: QuietCart) -> None:
    enabled(cart)
    assert cart.ask("clutch", "PSM1", 1.0).outcomes == ["done"]
    cart.run(50)


def lifting_by_button(cart: QuietCart) -> None:
    enabled(cart)
    cart.io.pressed.add("motor_up")
    cart.run(50)
    assert cart.state_of("lift") == 1.0


def lifting_by_command(cart: QuietCart) -> None:
    enabled(cart)
    assert cart.ask("set_lift_velocity", "", -1.0).outcomes == ["done"]
    cart.run(50)
    assert cart.state_of("lift") == -1.0


def in_fault(cart: QuietCart) -> None:
    enabled(cart)
    cart.io.trip(9)
    cart.run(10)
    assert cart.now_in is SetupState.FAULT


def without_io(cart: QuietCart) -> None:
    enabled(cart)
    cart.io.restart()


EVERYWHERE = (disabled, enabled)
STATES = [
    *((CLASSIC, way, away) for way in (disabled, powering, almost_enabled, enabled, clutched_by_button,
                                       clutched_by_command, lifting_by_button, lifting_by_command, in_fault, without_io)
      for away in AWAY_MS),
    *((SI, way, "killed") for way in (*EVERYWHERE, clutched_by_button, clutched_by_command)),
    (SI, clutched_by_button, "stalled for 31 ms"),
    *((kind, way, "killed") for kind in ("KINEMATIC", FIXED) for way in EVERYWHERE)]


@pytest.mark.parametrize(("kind", "reach", "away"), STATES,
                         ids=[f"{kind} {way.__name__} {away}" for kind, way, away in STATES])
def test_all_that_a_new_process_orders_of_io_is_accepted(kind: str, reach: Callable[[QuietCart], None],
                                                         away: str) -> None:
    cart = QuietCart(kind)
    cart.link.period_ns = EmulatedBoards.PERIOD_NS
    cart.run(20)
    reach(cart)
    assert cart.io.refused == []
    for _ in range(AWAY_MS[away]):
        cart.now_ns += MS
        cart.io.write(cart.now_ns)
    cart.io.origin = type(cart.io.origin)(0, 0, "")  # a new place in io's mailbox
    cart.start()
    cart.run(100)
    for button in (BUTTON, "motor_up", "motor_down"):  # as it is, released, pressed, released
        for pressed in (False, True, False):
            (cart.io.pressed.add if pressed else cart.io.pressed.discard)(button)
            cart.pressed[1] = pressed
            cart.run(50)
    assert cart.io.refused == []
    assert cart.state_of("lift") == 0.0
    request = cart.ask("state_command", "disable")
    cart.run(20)
    assert request.outcomes[-1] == "done" and cart.io.refused == []
