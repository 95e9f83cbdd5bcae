"""The arrays of an arm that native code was given stay where they are, whatever is asked of it and put on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.arm.fake_psm import with_adapter
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.library import native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")


def bound(function: Any) -> BoundStruct:
    """What a function of the native library works on."""
    found = function.args[0].keeps
    assert isinstance(found, BoundStruct)
    return found


def moved(arm: Any) -> list[str]:
    control = arm.control
    functions = [control.cartesian._show, control.io._update, control.setpoint._show, control._effort_limits._bear]
    if control.joints.kinematics is not None:
        functions += [control.joints.kinematics._update, control.joints.inverse._newton,
                      control.joints.inverse.kinematics._update]
        near = arm.cartesian_commands._reach._near
        if near is not None and near.solver is control.joints.inverse:
            functions += [near._find]
    return [name for function in functions for name in bound(function).moved()]


@pytest.mark.slow
def test_nothing_moves_with_commands_base_and_instruments() -> None:
    psm = with_adapter(tool_detection="AUTOMATIC")
    for memory in ("LARGE_NEEDLE_DRIVER:400006[3]", "MEGA_NEEDLE_DRIVER:400194[1]"):
        psm.io.memory = memory
        psm.put_on("tool")
        psm.until(lambda: psm.homed_flag and psm.state["count"] == 6)
        psm.go((0.1, -0.1, 0.12, 0.2, 0.1, -0.1))
        assert not moved(psm.arm), "a move"
        psm.send("set_base_frame", (0.1, 0.2, 0.3, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)), "world")
        psm.step()
        for shift in (0.0, 0.001, 3.0):  # the last is out of reach
            goal = psm.state["setpoint_cp"].copy()
            goal[0] += shift
            assert psm.send("servo_cp", (*goal, *(0.01,) * 6)).outcomes[-1] == ("refused" if shift > 1.0 else "done")
            psm.step()
            assert not moved(psm.arm), "a pose"
        psm.send("body/servo_cf", (0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
        psm.run(0.05)
        assert not moved(psm.arm), "efforts"
        psm.take_off("tool")
        psm.run(0.2)
        assert psm.retracted().state["count"] == 7
