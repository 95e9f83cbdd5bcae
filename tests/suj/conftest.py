"""A cart that several files begin with."""

from __future__ import annotations

import pytest

from tests.suj.test_edges import QuietCart
from trocar.procs.document.cart import CLASSIC
from trocar.procs.suj.machine import SetupState


@pytest.fixture
def enabled() -> QuietCart:
    cart = QuietCart(CLASSIC)
    cart.run(10)
    cart.ask("state_command", "home")
    cart.run(100)
    assert cart.now_in is SetupState.ENABLED, cart.log
    return cart
