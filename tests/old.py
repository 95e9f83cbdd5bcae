"""Old configuration files made up for tests: their spelling and units are the formats', their numbers are ours."""

from __future__ import annotations

from trocar.tools.converters import Converted, convert_file

GEAR = 2.5e-4  # deg/bit


def drive(offset: float = 32700.0, effort: str = '<NmToAmps Scale="0.5"/>') -> str:
    return (
        f'<Drive><AmpsToBits Scale="-5242.88" Offset="{offset}"/>'
        f'<BitsToFeedbackAmps Scale="-0.000190735" Offset="6.25"/>{effort}<MaxCurrent Value="1.2" Unit="A"/></Drive>'
    )


def actuator(number: int, *, kind: str = "Revolute", unit: str | None = None, limits: bool = True, extra: str = "",
             board: int = 6) -> str:
    """An actuator as version 4 spells it; with `unit`, its elements say so."""
    said = f' Unit="{unit}"' if unit else ""
    soft = f'<PositionLimitsSoft Lower="-90" Upper="45"{said}/>' if limits else ""
    return (
        f'<Actuator ActuatorID="{number}" BoardID="{board + number // 4}" AxisID="{number % 4}" Type="{kind}">\n'
        f"{drive(32700.0 + number)}\n"
        f'<Encoder VelocitySource="FIRMWARE"><BitsToPosSI Scale="{GEAR}"{said}/>{soft}</Encoder>\n'
        f'<AnalogIn><BitsToVolts Scale="6.9e-05" Offset="0"/><VoltsToPosSI Scale="-40" Offset="90"{said}/></AnalogIn>\n'
        f"{extra}</Actuator>\n"
    )


def robot(actuators: str, count: int, *, name: str = "PSM1", attributes: str = 'HardwareVersion="QLA1" SN="01234"',
          inside: str = "") -> str:
    return f'<Robot Name="{name}" NumOfActuator="{count}" {attributes}>\n{actuators}{inside}</Robot>\n'


def config(inside: str, version: int | None = 4) -> bytes:
    reported = f' Version="{version}"' if version is not None else ""
    return f'<?xml version="1.0" encoding="utf-8"?>\n<Config{reported}>\n{inside}</Config>\n'.encode()


def three(unit: str | None = "deg", **more: str) -> str:
    """A robot of three actuators that turn."""
    return robot("".join(actuator(number, unit=unit) for number in range(3)), 3, **more)


def matrix(tag: str, rows: list[list[float]]) -> str:
    inside = "".join(f'<Row Val="{" ".join(str(value) for value in row)}"/>' for row in rows)
    return f"<{tag}>{inside}</{tag}>\n"


def pid(joints: str, count: int) -> bytes:
    head = f'<controller type="PID" interface="JointTorqueInterface" numofjoints="{count}">'
    return f"{head}\n<joints>\n{joints}</joints>\n</controller>\n".encode()


def joint(number: int, *, kind: str = "Revolute", gains: str = "", limit: str = "", integral: float = 0.0) -> str:
    bounds = limit or '<limit MinILimit="-5" MaxILimit="5" ErrorLimit="0.3" Units="rad"/>'
    return (
        f'<joint index="{number}" name="axis_{number}" type="{kind}">'
        f'<pid PGain="20" DGain="0.5" IGain="{integral}" OffsetTorque="0.1" Forget="0.9" {gains}/>'
        f'{bounds}<pos LowerLimit="-10" UpperLimit="10" Units="deg"/></joint>\n'
    )


def convert(data: bytes | str, name: str = "old.xml") -> Converted:
    return convert_file(name, data.encode() if isinstance(data, str) else data)


def only(data: bytes | str, name: str = "old.xml") -> dict:  # type: ignore[type-arg]
    """The one file that an old one becomes."""
    result = convert(data, name)
    assert result.problems == ()
    (output,) = result.outputs
    return output.data


def outcomes(result: Converted) -> dict[str, str]:
    """The outcome of every key that is reported."""
    return {change.key: change.outcome for change in result.changes}


def one_problem(data: bytes | str, name: str = "old.xml") -> str:
    """The one mistake in a file, as a person reads it."""
    result = convert(data, name)
    assert result.outputs == ()
    (problem,) = result.problems
    return str(problem)
