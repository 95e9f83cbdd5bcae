"""Old PID XML: gains and limits, what the new format needs beside them, and what it cannot say."""

from __future__ import annotations

import math

import pytest

from tests.old import convert, joint, one_problem, only, outcomes, pid
from trocar.tools.converters import DEFAULTED, DROPPED, LOST


def row(text: str) -> dict:  # type: ignore[type-arg]
    return only(pid(text, 1))["pid"][0]


def test_gains_and_limits_go_over() -> None:
    assert row(joint(0, gains='LowPassCutoff="0.5"', integral=0.2)) == {
        "index": 0,
        "name": "axis_0",
        "type": "REVOLUTE",
        "p_gain": 20.0,
        "d_gain": 0.5,
        "i_gain": 0.2,
        "i_forget_rate": 0.9,
        "offset": 0.1,
        "v_low_pass_cutoff": 0.5,
        "p_measured_setpoint_tolerance": 0.3,
        "i_limit": 5.0,
        "pid_max_output": -1.0,
    }


def test_output_without_limit_is_told_as_defaulted() -> None:
    assert outcomes(convert(pid(joint(0), 1)))["joints/joint/pid_max_output"] == DEFAULTED


def test_position_limits_are_dropped_and_told() -> None:
    reported = outcomes(convert(pid(joint(0) + joint(1), 2)))
    assert reported["joints/joint[2]/pos@LowerLimit"] == reported["joints/joint[1]/pos@Units"] == DROPPED


@pytest.mark.parametrize("kind", ["Revolute", "Prismatic"])
def test_dead_band_was_in_degrees_on_every_joint(kind: str) -> None:
    found = row(joint(0, kind=kind, limit='<limit Deadband="0.5" ErrorLimit="0.1"/>'))
    assert found["p_deadband"] == math.radians(0.5)
    assert found["p_measured_setpoint_tolerance"] == 0.1
    assert found["type"] == kind.upper()


def test_absent_integral_limit_stays_without_effect() -> None:
    assert row(joint(0, limit='<limit ErrorLimit="0.1"/>', integral=0.2))["i_limit"] == 1e6
    assert "i_limit" not in row(joint(0, limit='<limit ErrorLimit="0.1"/>'))


@pytest.mark.parametrize(("integral", "outcome"), [(0.0, DROPPED), (0.2, LOST)])
def test_uneven_integral_limits_are_lost_where_they_count(integral: float, outcome: str) -> None:
    limit = '<limit MinILimit="-2" MaxILimit="5" ErrorLimit="0.1"/>'
    result = convert(pid(joint(0, limit=limit, integral=integral), 1))
    assert outcomes(result)["joints/joint/limit@MinILimit"] == outcome
    assert result.complete is (outcome == DROPPED)
    assert result.outputs[0].data["pid"][0]["i_limit"] == 2.0  # type: ignore[index]


@pytest.mark.parametrize(("band", "outcome"), [("0.0", DROPPED), ("0.35", LOST)])
def test_nonlinear_gain_is_lost_where_it_was_used(band: str, outcome: str) -> None:
    result = convert(pid(joint(0, gains=f'Nonlinear="{band}"'), 1))
    assert outcomes(result)["joints/joint/pid@Nonlinear"] == outcome
    assert result.complete is (outcome == DROPPED)


def test_type_of_the_first_versions_follows_the_limits() -> None:
    text = joint(0).replace(' type="Revolute"', "") + joint(1).replace(' type="Revolute"', "").replace("deg", "mm")
    assert [found["type"] for found in only(pid(text, 2))["pid"]] == ["REVOLUTE", "PRISMATIC"]


def test_inactive_gripper_has_no_row() -> None:
    data = only(pid(joint(0) + '<joint index="1" name="grip" type="Inactive"/>\n', 2))
    assert [found["name"] for found in data["pid"]] == ["axis_0"]


def test_joints_beyond_the_number_are_dropped() -> None:
    result = convert(pid(joint(0) + joint(1), 1))
    assert len(result.outputs[0].data["pid"]) == 1  # type: ignore[arg-type]
    assert outcomes(result)["joints/joint[2]/pid@PGain"] == DROPPED


def test_an_inactive_joint_before_others_is_refused() -> None:
    text = joint(0).replace("Revolute", "Inactive") + joint(1)
    assert "joint[1]@type = Inactive: unknown word; allowed: Revolute, Prismatic" in one_problem(pid(text, 2))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('PGain="20"', "", "old.xml:3: error: joints/joint/pid@PGain: this attribute is required; allowed: a number"),
        ('PGain="20"', 'PGain="much"', "joints/joint/pid@PGain = much: not a finite number"),
        ('numofjoints="1"', 'numofjoints="2"', "the file lists only 1 joint; allowed: 1, or as many joints"),
        ('interface="JointTorqueInterface"', 'interface="Other"', "unknown word; allowed: JointTorqueInterface"),
        ('Units="rad"', 'Units="deg"', "was read as rad whatever the file says; allowed: rad, m"),
        ('type="PID"', 'type="LQR"', "no known kind of file; allowed: Config (IO), controller with type PID"),
    ],
)
def test_mistakes_say_what_where_and_what_is_allowed(old: str, new: str, expected: str) -> None:
    text = pid(joint(0), 1).decode()
    assert old in text
    assert expected in one_problem(text.replace(old, new, 1))
