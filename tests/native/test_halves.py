"""The halves of io's cycle leave the same bits by native code and by numpy, from any sample, gains and state, and in
every scenario.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.io.harness import IoHarness, actuator, gains, robot
from tests.native.shadow import ShadowedHalves
from trocar.procs.document.system import Brake, Linear
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import IO
from trocar.procs.native.library import SWITCH, bind, native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ("tests/io/test_io_safety.py", "tests/io/test_real_robots.py", "tests/io/test_all_controllers.py",
             "tests/io/test_io_bias.py", "tests/io/test_io_tasks.py", "tests/whole/test_replay.py",
             "-k", "not (board_that_all_others or lost_reply or over_budget)")
ODD = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e300, -1e-310])
CONSTANTS = ("index", "velocity_index", "out_index", "table_row", "pot_first", "pot_count", "first_axis", "shift",
             "mask", "input_index", "output_index", "hz", "effort_limit", "output_limit", "relay_unseen", "software",
             "switches")
"""What numpy has worked something out of already."""


def with_everything() -> IoHarness:
    """Dead-bands, filters, observers, limits, brakes, currents that are compared, velocities of both kinds."""
    axes = tuple(actuator(i // 4, i % 4) for i in range(7))
    soft = dataclasses.replace(axes[2], encoder=dataclasses.replace(axes[2].encoder, velocity_source="SOFTWARE"))
    row = robot("PSM1", 0, actuators=(*axes[:2], soft, *axes[3:]),
                brakes=(Brake(1, 3, Linear(5242.88, 32768.0), Linear(1e-4, -6.25), 1.0, 0.8, 0.1, 0.2, 0.0),))
    harness = IoHarness(robots=(row,), current_error_a=0.2, current_error_s=0.1)
    pid = harness.core.pid
    rich = gains(d_gain=0.1, i_gain=0.2, i_limit=0.3, i_forget_rate=0.99, offset=0.01, p_deadband=0.01,
                 p_deadband_outer=0.05, v_low_pass_cutoff=0.3, pid_max_output=0.8, use_disturbance_observer=True,
                 disturbance_cutoff=20.0, nominal_mass=0.4)
    pid.configure({0: rich, 3: rich, 5: dataclasses.replace(rich, p_deadband_outer=0.0)}, np.zeros(7))
    return harness


def stir(bound: BoundStruct, rng: np.random.Generator, odd: float) -> None:
    """Fill all that a stage may find with anything at all; a share `odd` of numbers is not ordinary."""
    for name, array in bound.arrays.items():
        if name in CONSTANTS or not array.flags.writeable or not array.size:
            continue
        if array.dtype.kind == "f":
            array[...] = rng.normal(0.0, 10.0 ** rng.integers(-3, 4), array.shape)
            array[rng.random(array.shape) < odd] = rng.choice(ODD)
        elif array.dtype.kind == "b":
            array[...] = rng.random(array.shape) < 0.5
        elif name == "out_flags":
            array[...] = 0x8000_0000
        else:
            array[...] = rng.integers(0, np.iinfo(array.dtype).max // 2, array.shape, dtype=array.dtype)


@given(st.integers(0, 2**32 - 1), st.sampled_from((0.0, 0.02, 0.3)), st.booleans())
@pytest.mark.slow
def test_both_halves_leave_the_same_bits_from_anything(seed: int, odd: float, rich: bool) -> None:
    rng = np.random.default_rng(seed)
    harness = with_everything() if rich else IoHarness()
    core = harness.core
    halves, bound = ShadowedHalves(core.parts, harness.context, (0, 1.0, 1.0)), bind(IO, core.parts)
    assert isinstance(bound, BoundStruct)
    core.pid.check_tracking(slice(None), True)
    for on in (True, False):
        core.pid.enable(slice(0, 5), on, core.samples.position)
        core.pid.use_effort(slice(1, 3), on)
        stir(bound, rng, odd)
        for _ in range(3):
            core.port.blocks[...] = rng.integers(0, 2**32, core.port.blocks.shape, dtype=np.uint32)
            halves.decode_and_check()
            halves.control_and_encode(float(rng.choice((1.0, 0.5, 0.0))), int(rng.random() < 0.8))
            core.samples.wanted[0] = rng.integers(4)
            halves.show()


def test_arrays_stay_where_they_are_whatever_is_asked() -> None:
    harness = IoHarness()
    bound = bind(IO, harness.core.parts)
    assert isinstance(bound, BoundStruct)
    harness.control()
    for name, values in (("bias_encoders", (20,)), ("tracking_check", (1,)), ("use_setpoint_v", (1,)),
                         ("enforce_limits", (1,)), ("pot_check", (1,)), ("pid_enable", (0,)), ("power_off", ())):
        harness.ask(name, *values)
        harness.run(60)
        assert not bound.moved(), f"{name} has put them elsewhere"
    harness.core.pid.configure({0: gains(p_gain=3.0)}, np.zeros(7))
    harness.core.shutdown()
    assert not bound.moved()


def test_an_array_of_another_shape_is_refused_and_numpy_does_the_work() -> None:
    harness = IoHarness()
    harness.core.pid.p_gain = np.zeros(3)
    why = bind(IO, harness.core.parts)
    assert why == "Io.pid_p_gain (pid.p_gain) is float64 (3,), not float64 (7,)"


@pytest.mark.slow
def test_every_cycle_of_the_scenarios_is_the_same_by_native_and_numpy() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.native.shadow", "-p", "no:cacheprovider", "-m",
               "not slow", *SCENARIOS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "compared 0 stages" not in done.stdout


def test_without_native_code_numpy_does_the_work_and_says_why() -> None:
    code = "from tests.io.harness import IoHarness; print(IoHarness().core.halves.why_numpy)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env={SWITCH: "0"}, capture_output=True, text=True,
                          timeout=60, check=True)
    assert done.stdout == "TROCAR_NATIVE is 0\n"
