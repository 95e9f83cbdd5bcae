"""Old IO XML: units, spellings, brakes, potentiometers, inputs; what is reported of it and what is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.old import GEAR, actuator, config, convert, drive, matrix, one_problem, only, outcomes, robot, three
from trocar.tools.converters import DEFAULTED, DROPPED, LOST

NUMBERS = st.floats(min_value=-1e6, max_value=1e6, allow_nan=False)


def first(data: bytes) -> dict:  # type: ignore[type-arg]
    return only(data)["robots"][0]


@given(NUMBERS)
def test_degrees_of_version_four_become_radians(scale: float) -> None:
    text = actuator(0, unit="deg").replace(f'Scale="{GEAR}"', f'Scale="{scale!r}"')
    row = first(config(robot(text, 1)))["actuators"][0]
    assert row["encoder"]["bits_to_position"]["scale"] == pytest.approx(scale * math.pi / 180, rel=1e-15, abs=0)
    assert row["encoder"]["position_limits_soft"] == {"lower": -math.pi / 2, "upper": math.pi / 4}
    assert row["potentiometer"]["voltage_to_position"]["offset"] == pytest.approx(math.pi / 2)


@given(NUMBERS)
def test_millimetres_of_version_four_become_metres(scale: float) -> None:
    text = actuator(0, kind="Prismatic", unit="mm").replace(f'Scale="{GEAR}"', f'Scale="{scale!r}"')
    row = first(config(robot(text, 1)))["actuators"][0]
    assert row["encoder"]["bits_to_position"]["scale"] == pytest.approx(scale / 1000, rel=1e-15, abs=0)
    assert row["encoder"]["position_limits_soft"] == {"lower": -0.09, "upper": 0.045}


@pytest.mark.parametrize("version", [2, 3, 4, 5])
def test_old_spelling_without_units_means_degrees(version: int) -> None:
    encoder = first(config(three(unit=None), version))["actuators"][0]["encoder"]
    assert encoder["bits_to_position"]["scale"] == math.radians(GEAR)


def new_spelling(text: str) -> str:
    for old, new in (("BoardID", "BoardId"), ("AxisID", "AxisId"), (' ActuatorID="0"', ""), ("SN=", "SerialNumber="),
                     ('Type="Revolute"', 'JointType="REVOLUTE"'), ("NmToAmps", "EffortToCurrent")):
        text = text.replace(old, new)
    return text


def test_version_five_is_in_si_units() -> None:
    result = convert(config(new_spelling(robot(actuator(0), 1)), 5))
    (output,) = result.outputs
    row = output.data["robots"][0]  # type: ignore[index]
    assert row["serial_number"] == "01234"
    assert row["actuators"][0]["encoder"]["bits_to_position"]["scale"] == GEAR
    assert row["actuators"][0]["drive"]["effort_to_current"] == {"scale": 0.5}
    assert result.changes == ()


def test_a_stated_unit_counts_before_the_version() -> None:
    text = config(new_spelling(robot(actuator(0, unit="deg"), 1)), 5)
    assert first(text)["actuators"][0]["encoder"]["bits_to_position"]["scale"] == math.radians(GEAR)


def test_numbers_without_units_stay_as_they_are() -> None:
    row = first(config(three()))["actuators"][1]
    assert row["drive"] == {
        "effort_to_current": {"scale": 0.5},
        "current_to_bits": {"scale": -5242.88, "offset": 32701.0},
        "bits_to_current": {"scale": -0.000190735, "offset": 6.25},
        "maximum_current": 1.2,
    }
    assert (row["board_id"], row["axis_id"], row["joint_type"]) == (6, 1, "REVOLUTE")


def test_serial_number_keeps_its_zeros() -> None:
    assert first(config(three()))["serial_number"] == "01234"


def test_what_old_versions_lack_is_defaulted_and_told() -> None:
    text = actuator(0, limits=False).replace(' VelocitySource="FIRMWARE"', "")
    result = convert(config(robot(text, 1, attributes="")))
    reported = {change.key: change.new for change in result.changes if change.outcome == DEFAULTED}
    assert reported == {
        "Robot@SerialNumber": '""',
        "Robot@HardwareVersion": "QLA1",
        "Robot/Actuator/Encoder@VelocitySource": "FIRMWARE",
    }


def test_absent_position_limits_are_left_to_a_person() -> None:
    result = convert(config(robot(actuator(0, limits=False), 1)))
    assert outcomes(result)["Robot/Actuator/Encoder/PositionLimitsSoft"] == LOST
    assert not result.complete
    limits = result.outputs[0].data["robots"][0]["actuators"][0]["encoder"]["position_limits_soft"]  # type: ignore[index]
    assert limits == {"lower": 0.0, "upper": 0.0}


@pytest.mark.parametrize(
    ("old", "new", "hardware"),
    [("x", "x", "QLA1"), ('AxisID="0"', 'AxisID="5"', "DQLA"), ('AxisID="0"', 'AxisID="9"', "dRA1"),
     ("5242.88", "4800.0", "dRA1")],
)
def test_hardware_is_told_from_axes_and_scales(old: str, new: str, hardware: str) -> None:
    text = robot(actuator(0), 1, attributes='SN="1"').replace(old, new)
    assert first(config(text))["hardware_version"] == hardware


def test_velocity_scales_and_counts_per_turn_are_dropped_key_by_key() -> None:
    more = '<BitsToDeltaPosSI Scale="3" Offset="0"/><CountsPerTurn Value="4000"/></Encoder>'
    reported = outcomes(convert(config(robot(actuator(0).replace("</Encoder>", more), 1))))
    inside = "Robot/Actuator/Encoder"
    for key in ("BitsToDeltaPosSI@Scale", "BitsToDeltaPosSI@Offset", "CountsPerTurn@Value"):
        assert reported[f"{inside}/{key}"] == DROPPED


def test_unknown_keys_are_dropped_and_told() -> None:
    text = three().replace("<Robot ", '<Robot Colour="red" ')
    text = text.replace("</Robot>", "<Cover><Screw Size='3'/></Cover></Robot>")
    reported = outcomes(convert(config(text)))
    assert reported["Robot@Colour"] == DROPPED
    assert reported["Robot/Cover/Screw@Size"] == DROPPED


def test_brakes_become_a_list_of_their_own() -> None:
    brake = (
        '<AnalogBrake BoardID="7" AxisID="1"><AmpsToBits Scale="5242.88" Offset="32768"/>'
        '<BitsToFeedbackAmps Scale="0.000190735" Offset="-6.25"/><MaxCurrent Value="0.25"/>'
        '<ReleaseCurrent Value="0.2"/>'
        '<ReleaseTime Value="2" Unit="s"/><ReleasedCurrent Value="0.08"/><EngagedCurrent Value="0"/></AnalogBrake>'
    )
    row = first(config(robot(actuator(0) + actuator(1, extra=brake) + actuator(2), 3)))
    assert row["number_of_brakes"] == 1
    (only_brake,) = row["brakes"]
    assert (only_brake["board_id"], only_brake["axis_id"]) == (7, 1)
    assert (only_brake["release_time"], only_brake["released_current"]) == (2.0, 0.08)
    assert "effort_to_current" not in only_brake["drive"]


def test_tolerances_are_converted_by_the_unit_of_each() -> None:
    inside = ('<Potentiometers Position="Actuators"><Tolerance Axis="0" Distance="5" Latency="0.01" Unit="deg"/>'
              '<Tolerance Axis="1" Distance="5" Latency="0.02" Unit="mm"/></Potentiometers>')
    text = robot(actuator(0) + actuator(1, kind="Prismatic"), 2, inside=inside)
    pots = first(config(text))["potentiometers"]
    assert pots["potentiometers_type"] == "ANALOG" and "coupling" not in pots
    assert pots["tolerances"] == [
        {"axis_id": 0, "distance": math.radians(5), "latency": 0.01},
        {"axis_id": 1, "distance": 0.005, "latency": 0.02},
    ]


def test_lookup_table_makes_potentiometers_digital() -> None:
    pots = first(config(three(inside='<Potentiometers LookupTable="table-01234.json"/>')))["potentiometers"]
    assert pots == {"potentiometers_type": "DIGITAL", "lookup_table_file": "table-01234.json"}


FORWARD = [[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.5, -0.5, 1.0]]
BACK = [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.5, 1.0]]


def block(place: str, *matrices: str) -> str:
    return f'<Potentiometers Position="{place}"/><Coupling Value="1">{"".join(matrices)}</Coupling>'


def test_coupling_block_serves_potentiometers_on_joints() -> None:
    inside = block("Joints", matrix("ActuatorToJointPosition", FORWARD), matrix("JointToActuatorPosition", BACK),
                   matrix("ActuatorToJointTorque", BACK), matrix("JointToActuatorTorque", FORWARD))
    result = convert(config(three(inside=inside)))
    assert first(config(three(inside=inside)))["potentiometers"]["coupling"] == {"JointToActuatorPosition": BACK}
    reported = outcomes(result)
    for tag in ("ActuatorToJointPosition", "ActuatorToJointTorque", "JointToActuatorTorque"):
        assert reported[f"Robot/Coupling/{tag}"] == DROPPED


def test_missing_coupling_matrix_is_the_inverse() -> None:
    inside = block("Joints", matrix("ActuatorToJointPosition", FORWARD))
    assert first(config(three(inside=inside)))["potentiometers"]["coupling"] == {"JointToActuatorPosition": BACK}


def test_coupling_of_potentiometers_on_actuators_is_dropped() -> None:
    inside = block("Actuators", matrix("ActuatorToJointPosition", FORWARD))
    assert "coupling" not in first(config(three(inside=inside)))["potentiometers"]
    changes = [change for change in convert(config(three(inside=inside))).changes if change.key.endswith("@Position")]
    assert "no matrix" in changes[0].reason


def test_contradicting_matrices_are_lost() -> None:
    inside = block("Joints", matrix("ActuatorToJointPosition", FORWARD), matrix("JointToActuatorPosition", FORWARD))
    (lost,) = convert(config(three(inside=inside))).lost
    assert "not the inverse of ActuatorToJointPosition" in lost.reason


def test_gripper_of_old_masters_becomes_a_file_of_its_own() -> None:
    text = robot("".join(actuator(number, board=2) for number in range(8)), 8, name="MTMR", attributes='SN="22222"',
                 inside=block("Joints", matrix("ActuatorToJointPosition", [[float(i == j) for j in range(8)]
                                                                           for i in range(8)])))
    result = convert(config(text, 2), "sawRobotIO1394-MTMR-foot-pedal-22222.xml")
    main, gripper = result.outputs
    assert (main.name, gripper.name) == ("sawRobotIO1394-MTMR-foot-pedal-22222.json",
                                         "sawRobotIO1394-MTMR-gripper-22222.json")
    (arm,), (hand,) = main.data["robots"], gripper.data["robots"]  # type: ignore[misc]
    assert len(arm["actuators"]) == arm["number_of_actuators"] == 7
    assert len(arm["potentiometers"]["coupling"]["JointToActuatorPosition"]) == 7
    assert (hand["name"], hand["only_IO"], hand["actuators"][0]["axis_id"]) == ("MTMR_gripper", True, 3)
    assert "encoder" not in hand["actuators"][0]
    assert outcomes(result)["Robot/Actuator[8]/Encoder/BitsToPosSI@Scale"] == DROPPED


def test_io_only_robots_need_no_encoders_and_efforts() -> None:
    pot = '<AnalogIn><BitsToVolts Scale="1" Offset="0"/></AnalogIn>'
    text = f'<Actuator BoardID="12" AxisID="0">{drive(effort="")}{pot}</Actuator>'
    row = first(config(robot(text, 1, name="SUJ", attributes='Type="io-only" HardwareVersion="QLA1"')))
    assert row["only_IO"] is True
    assert "encoder" not in row["actuators"][0] and "effort_to_current" not in row["actuators"][0]["drive"]


def test_inputs_get_the_names_of_today() -> None:
    text = "".join(
        f'<DigitalIn BoardID="6" BitID="{bit}" Name="{name}" Pressed="1" Trigger="all" Debounce="0.2"/>'
        for bit, name in enumerate(("CLUTCH", "Cam+", "PSM1-ManipClutch", "HeadSensor2", "my button!"))
    ) + '<DallasChip BoardID="7" Name="PSM1-Dallas"/>'
    data = only(config(text))
    assert [row["name"] for row in data["digital_inputs"]] == [
        "clutch", "focus_plus", "PSM1_arm_clutch", "dv_head_sensor_2", "my_button_"]
    assert data["dallas_chips"] == [{"name": "PSM1_dallas", "board_id": 7}]


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ('Debounce="0.5"', {"debounce_time": 0.5, "debounce_time_click": 0.1}),
        ('Debounce="0.5" DebounceClick="0.5"', {"debounce_time": 0.5, "debounce_time_click": 0.5}),
        ("", {"debounce_time": 0.0}),
        ('SkipFirstRun="1"', {"debounce_time": 0.0, "skip_first_run": True}),
    ],
)
def test_click_time_is_a_fifth_of_the_debounce_time(attributes: str, expected: dict[str, object]) -> None:
    (row,) = only(config(f'<DigitalIn BoardID="1" BitID="2" Name="b" Pressed="0" Trigger="press" {attributes}/>'))[
        "digital_inputs"]
    place = {"name": "b", "board_id": 1, "bit_id": 2, "pressed_value": False}
    assert row == place | {"trigger_when_pressed": True, "trigger_when_released": False} | expected


def test_outputs_with_a_frequency_are_modulated() -> None:
    data = only(config('<DigitalOut BoardID="12" BitID="2" Name="ControlPWM" Frequency="40000"/>'
                       '<DigitalOut BoardID="12" BitID="0" Name="NoMuxReset" LowDuration="0.0001"/>'))
    modulated, page = data["digital_outputs"]
    assert (modulated["is_PWM"], modulated["PWM_frequency"]) == (True, 40000.0)
    assert (page["is_PWM"], page["low_duration"], page["name"]) == (False, 0.0001, "no_mux_reset")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('BoardID="6"', 'BoardID="16"', "Actuator@BoardID = 16: out of range; allowed: a whole number from 0 to 15"),
        ('Unit="A"', 'Unit="mA"', "MaxCurrent@Unit = mA: was read as A whatever the file says; allowed: A"),
        ('Unit="deg"', 'Unit="mm"', "BitsToPosSI@Unit = mm: no unit for a joint that is REVOLUTE; allowed: deg, rad"),
        ('Lower="-90"', 'Lower="-9O"', "PositionLimitsSoft@Lower = -9O: not a finite number"),
        ('Lower="-90"', 'Lower="1e999"', "not a finite number"),
        ('Type="Revolute"', 'Type="Round"', "unknown word; allowed: Revolute, REVOLUTE, Prismatic, PRISMATIC"),
        ('NumOfActuator="1"', 'NumOfActuator="2"', "the file has 1 actuators; allowed: 1"),
        ("<NmToAmps Scale=\"0.5\"/>", "", "Drive/EffortToCurrent: this element is required"),
        ('HardwareVersion="QLA1"', 'HardwareVersion="QLA7"', "unknown word; allowed: QLA1, DQLA, dRA1"),
        ('Version="4"', 'Version="6"', "Version = 6: out of range; allowed: a whole number from 1 to 5"),
        ('SN="01234"', 'SerialNumber="1"', "both spellings in one file"),
    ],
)
def test_mistakes_say_what_where_and_what_is_allowed(old: str, new: str, expected: str) -> None:
    text = config(robot(actuator(0, unit="deg"), 1)).decode()
    assert old in text
    found = one_problem(text.replace(old, new, 1))
    assert expected in found and found.startswith("old.xml:")


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ('Trigger="both"', "Trigger = both: unknown word; allowed: all, press, release, none"),
        ("", "Trigger: this attribute is required"),
        ('Trigger="all" Debounce="0.1" DebounceClick="0.2"', "out of range; allowed: up to Debounce (0.1)"),
        ('Trigger="all" Debounce="-1"', "out of range"),
    ],
)
def test_mistakes_in_inputs_are_refused(attributes: str, expected: str) -> None:
    text = f'<DigitalIn BoardID="1" BitID="2" Name="b" Pressed="0" {attributes}/>'
    assert expected in one_problem(config(text))


def test_an_empty_file_is_refused() -> None:
    assert "nothing in it" in one_problem(config(""))


BOMB = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f'<?xml version="1.0"?>{BOMB}<Config><Robot Name="&b;"/></Config>', "a DTD (<!DOCTYPE …>) is not accepted"),
        ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><Config/>', "is not accepted"),
        ("<Config><Robot></Config>", "old.xml:1: error: broken XML: mismatched tag"),
        ("<Config>&x;</Config>", "broken XML: undefined entity"),
        ("<a>" * 40, "nested deeper than 32"),
        ('<?xml version="1.0" encoding="klingon"?><Config/>', "broken XML"),
        ("<robots/>", "robots: no known kind of file"),
    ],
)
def test_dtds_and_broken_xml_are_refused(text: str, expected: str) -> None:
    assert expected in one_problem(text)
