"""Gains that change at run time: what is allowed, and that nothing remembered jumps."""

from __future__ import annotations

import inspect
import math
import re
from typing import Any

import numpy as np
import pytest
from annotated_types import Ge, Gt, Le
from hypothesis import given
from hypothesis import strategies as st

from tests.io.harness import pid_step
from trocar.procs.config.models.io_file import PidFile
from trocar.procs.config.read.shapes import fields_of, shape_of
from trocar.procs.document.gains import GAINS, changed, value_of
from trocar.procs.document.system import PidAxis
from trocar.procs.io import pid as controller
from trocar.procs.io.pid import Pid
from trocar.shm.topics import IO_GAINS

ROW = PidAxis("a", "REVOLUTE", 6.0, 0.1, 0.0, pid_max_output=-1.0)
ALL = slice(None)


def enabled(*rows: PidAxis) -> Pid:
    pid = Pid(rows, np.zeros(len(rows)), 1 / 1500)
    pid.enable(ALL, True, np.zeros(len(rows)))
    return pid


def step(pid: Pid, setpoint: float, velocity: float = 0.0) -> float:
    pid.setpoint_position[:] = setpoint
    n = len(pid.gains)
    pid_step(pid, np.zeros(n), np.full(n, velocity), np.zeros(n, dtype=bool))
    return float(pid.effort[0])


def test_the_table_agrees_with_pid_files_and_the_topic() -> None:
    rows = shape_of(PidFile).fields["pid"].rows
    assert rows is not None and rows.model is not None
    fields = {key: field for key, field in fields_of(rows.model).items() if key not in ("index", "name", "type")}
    assert {gain.key for gain in GAINS} == set(fields)
    assert [gain.key for gain in GAINS] == [field.name for field in IO_GAINS.fields[1:]]
    for gain in GAINS:
        limits: list[Any] = fields[gain.key].metadata
        low = [m.ge if isinstance(m, Ge) else m.gt for m in limits if isinstance(m, Ge | Gt)]
        high = [m.le for m in limits if isinstance(m, Le)]
        assert gain.switch or ((low or [-math.inf]) == [gain.low] and (high or [math.inf]) == [gain.high]), gain
        assert gain.above == any(isinstance(m, Gt) for m in limits)
        assert gain.switch == (fields[gain.key].annotation is bool)


def test_the_controller_uses_every_gain() -> None:
    text = inspect.getsource(controller)
    assert not {gain.field for gain in GAINS if len(re.findall(rf"self\.{gain.field}\b", text)) < 2}


def test_values_that_make_no_sense_are_refused_with_what_is_allowed() -> None:
    for key, value, allowed in (
        ("p_gain", -1.0, "from 0 up to 1e+06"), ("p_gain", math.nan, "from 0 up to 1e+06"),
        ("d_gain", math.inf, "from 0 up to 1e+06"), ("d_gain", 1e308, "from 0 up to 1e+06"),
        ("offset", math.nan, "from -1e+06 up to 1e+06"), ("i_forget_rate", 1.5, "from 0 up to 1"),
        ("v_low_pass_cutoff", 0.0, "above 0 up to 1"), ("use_disturbance_observer", 0.5, "1 (on) or 0 (off)"),
    ):
        with pytest.raises(ValueError, match="allowed") as refused:
            changed(ROW, [key], [value], running=False)
        assert str(refused.value).endswith(f"allowed: {allowed}")
    with pytest.raises(ValueError, match="no gain 'gain'; there are: p_gain, d_gain"):
        changed(ROW, ["gain"], [1.0], running=False)
    with pytest.raises(ValueError, match="twice"):
        changed(ROW, ["p_gain", "p_gain"], [1.0, 2.0], running=False)


def test_a_slip_of_the_decimal_point_is_refused_while_it_runs() -> None:
    with pytest.raises(ValueError, match="more than 10 times 6"):
        changed(ROW, ["p_gain"], [600.0], running=True)
    assert changed(ROW, ["p_gain"], [600.0], running=False).p_gain == 600.0
    assert changed(ROW, ["p_gain", "i_gain"], [60.0, 1.0], running=True).i_gain == 1.0
    with pytest.raises(ValueError, match=r"p_gain 0\.5 is less than 1/10 of 6; go there in smaller steps"):
        changed(ROW, ["p_gain"], [0.5], running=True)
    assert changed(ROW, ["p_gain"], [0.5], running=False).p_gain == 0.5
    for value in (0.6, 0.0):  # 0 is not a slip: it switches the term off
        assert changed(ROW, ["p_gain"], [value], running=True).p_gain == value


def test_what_makes_an_arm_shake_less_is_lowered_at_once() -> None:
    stiff = changed(ROW, ["i_gain"], [5.0], running=False)
    assert changed(stiff, ["i_gain"], [0.01], running=True).i_gain == 0.01


@given(st.sampled_from(GAINS), st.floats(allow_nan=True, allow_infinity=True))
def test_whatever_is_accepted_is_what_is_then_there(gain: Any, value: float) -> None:
    try:
        row = changed(ROW, [gain.key], [value], running=False)
    except ValueError:
        return
    assert value_of(row, gain.key) == value and math.isfinite(value)


def test_the_observed_disturbance_stays_when_the_observer_changes() -> None:
    row = PidAxis("a", "REVOLUTE", 600.0, 30.0, 0.0, pid_max_output=10.0, use_disturbance_observer=True,
                  nominal_mass=0.01, disturbance_cutoff=50.0)
    pid = enabled(row)
    for _ in range(50):
        step(pid, 0.001, 0.02)
    before = float(pid.disturbance[0])
    pid.configure({0: changed(row, ["nominal_mass"], [0.03], running=True)}, np.full(1, 0.02))
    step(pid, 0.001, 0.02)
    assert pid.disturbance[0] == pytest.approx(before, rel=0.05) and abs(before) > 0.005
    pid.configure({0: changed(row, ["use_disturbance_observer"], [0.0], running=True)}, np.full(1, 0.02))
    assert step(pid, 0.0, 0.0) == 0.0
