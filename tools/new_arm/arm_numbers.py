"""Motors, limits, brakes, potentiometers and buttons of each arm and generation, as the dVRK's generator writes them.

The names of `ARMS` are those that `--name` takes. Angles are in degrees here, insertion in mm, and gears of insertion
axes are in 1/m. Where a number differs between sources, the dVRK's generator counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

CLASSIC, SI = "Classic", "Si"
FIRMWARE, SOFTWARE = "FIRMWARE", "SOFTWARE"
INSERTION: Final = 2
"""The prismatic axis of a PSM and an ECM."""


@dataclass(frozen=True, slots=True)
class Motor:
    """One actuator: signs of drive and encoder, counts per turn, gear, torque constant (N·m/A), current limit (A), soft
    limits; `pitch`: sign of the screw.
    """

    drive: int
    encoder: int
    counts: float
    gear: float
    torque: float
    current: float
    lower: float
    upper: float
    velocity: str = FIRMWARE
    pitch: int = 1


@dataclass(frozen=True, slots=True)
class BrakeNumbers:
    """One brake: the largest current, the currents that release it and keep it released (A), release time (s)."""

    maximum: float
    release: float
    released: float
    time_s: float


@dataclass(frozen=True, slots=True)
class Button:
    """A digital input: name, board among those of the arm (QLA1), bit, debounce time (s)."""

    name: str
    board: int
    bit: int
    debounce_s: float


@dataclass(frozen=True, slots=True)
class ArmNumbers:
    """All numbers of one arm of one generation."""

    type: str
    kinematic: str
    motors: tuple[Motor, ...]
    tolerances: tuple[tuple[float, float], ...]
    """Of potentiometers: distance and latency (s)."""
    brakes: tuple[BrakeNumbers, ...] = ()
    buttons: tuple[Button, ...] = ()
    coupling: tuple[tuple[float, ...], ...] = ()
    """Of a master's potentiometers, joints to actuators."""
    mounting_pitch: float = 0.0


def _psm_classic() -> tuple[Motor, ...]:
    wrist = [Motor(sign, sign, 4000, 11.71, 0.0438, 0.67, -174, 174) for sign in (-1, -1, 1, 1)]
    return (Motor(-1, -1, 14400, 56.50, 0.0438, 1.34, -91, 91), Motor(-1, -1, 14400, 56.50, 0.0438, 1.34, -53, 53),
            Motor(1, 1, 14400, 336.6, 0.0438, 0.67, 0, 240), *wrist)


def _psm_si() -> tuple[Motor, ...]:
    wrist = [Motor(sign, -sign, 4000, 13.813, 0.0385, 1.1, -172, 172) for sign in (1, 1, -1, -1)]
    return (Motor(-1, 1, 81920, 83.3333, 0.0603, 3.4, -170, 170, SOFTWARE),
            Motor(1, -1, 81920, 85.000, 0.0603, 3.4, -73, 75, SOFTWARE),
            Motor(1, -1, 50000, 965.91, 0.0385, 1.1, 0, 290, SOFTWARE), *wrist)


def _master(left: bool) -> tuple[Motor, ...]:
    yaw, elbow = ((-40, 65), (-240, 120)) if left else ((-65, 40), (-120, 240))
    platform = -1 if left else 1
    return (Motor(-1, -1, 4000, 63.41, 0.0438, 0.67, *yaw), Motor(1, 1, 4000, 49.88, 0.0438, 0.67, -18, 65),
            Motor(1, 1, 4000, 59.73, 0.0438, 0.67, -15, 42), Motor(1, 1, 4000, 10.53, 0.0438, 0.67, *elbow),
            Motor(platform, platform, 64, 33.16, 0.00495, 0.59, -95, 185),
            Motor(1, 1, 64, 33.16, 0.00495, 0.59, -45, 45), Motor(-1, -1, 64, 16.58, 0.00339, 0.407, -475, 445))


GRIPPER: Final = Motor(-1, 1, 1, 1, 0.0438, 0.0, 0, 0, SOFTWARE)
"""A master's gripper has a Hall sensor and no motor: its drive is that of the first axis, its encoder unused."""

_ECM_CLASSIC: Final = (
    Motor(1, 1, 4000, 240, 0.1190, 0.943, -90, 90), Motor(1, 1, 4000, 240, 0.1190, 0.943, -45, 64),
    Motor(-1, -1, 640, 2748.55, 0.0438, 0.67, 0, 255), Motor(1, 1, 64, 300.15, 0.00495, 0.59, -89, 89))
_ECM_SI: Final = (
    Motor(-1, 1, 81920, 83.3333, 0.0603, 3.4, -170, 170, SOFTWARE),
    Motor(1, -1, 81920, 168.3333, 0.0603, 3.4, -64, 60, SOFTWARE),
    Motor(1, -1, 640, 2748.6, 0.0385, 0.67, 0, 260, SOFTWARE, pitch=-1),
    Motor(-1, -1, 64, 300.2, 0.0385, 0.59, -89, 89, SOFTWARE))

_WRISTS: Final = ((5.0, 0.01),) * 4
_CLASSIC_BUTTONS: Final = (Button("SUJ_clutch", 0, 0, 0.2), Button("arm_clutch", 0, 2, 0.2), Button("tool", 1, 7, 0.2),
                           Button("adapter", 1, 10, 0.2))
_ECM_BUTTONS: Final = (Button("arm_clutch", 0, 0, 0.2), Button("SUJ_clutch", 0, 2, 0.2))
_SI_BUTTONS: Final = (Button("SUJ_clutch_2", 0, 1, 0.01), Button("SUJ_clutch", 0, 4, 0.01), Button("tool", 0, 9, 1.5),
                      Button("adapter", 0, 10, 1.6), Button("arm_clutch", 0, 13, 0.01))
_ECM_SI_BUTTONS: Final = (Button("SUJ_clutch", 0, 4, 0.01), Button("arm_clutch", 0, 13, 0.01),
                          Button("SUJ_clutch_2", 0, 16, 0.01))
_COUPLING: Final = tuple(tuple({(2, 1): 1.0, (3, 2): 0.6697}.get((row, column), float(row == column))
                               for column in range(7)) for row in range(7))

PSM_SI_PITCH, PSM3_SI_PITCH, ECM_PITCH, ECM_SI_PITCH = -45.0, -15.0, -45.0, -70.0


def _psm(generation: str, pitch: float) -> ArmNumbers:
    if generation == CLASSIC:
        return ArmNumbers("PSM", "PSM", _psm_classic(), ((5.0, 0.01), (5.0, 0.01), (5.0, 0.01), *_WRISTS),
                          buttons=_CLASSIC_BUTTONS)
    brakes = (BrakeNumbers(0.2, 0.15, 0.08, 0.5),) * 2 + (BrakeNumbers(0.3, -0.25, -0.25, 0.5),)
    return ArmNumbers("PSM", "PSM_Si", _psm_si(), ((1.0, 0.01), (1.0, 0.01), (2.0, 0.01), *((3.0, 0.01),) * 4), brakes,
                      _SI_BUTTONS, mounting_pitch=pitch)


def _mtm(name: str) -> ArmNumbers:
    return ArmNumbers("MTM", name, _master(name == "MTML"), ((5.0, 0.01),) * 6 + ((0.0, 0.0),), coupling=_COUPLING)


ARMS: Final[dict[tuple[str, str], ArmNumbers]] = {
    ("MTML", CLASSIC): _mtm("MTML"),
    ("MTMR", CLASSIC): _mtm("MTMR"),
    ("ECM", CLASSIC): ArmNumbers(
        "ECM", "ECM", _ECM_CLASSIC, ((5.0, 0.01),) * 4,
        (BrakeNumbers(0.25, 0.25, 0.08, 2.0), BrakeNumbers(0.22, 0.22, 0.07, 2.0), BrakeNumbers(0.90, 0.90, 0.20, 2.0)),
        _ECM_BUTTONS, mounting_pitch=ECM_PITCH),
    ("ECM", SI): ArmNumbers(
        "ECM", "ECM_Si", _ECM_SI, ((1.0, 0.01), (1.0, 0.01), (2.0, 0.01), (3.0, 0.01)),
        (BrakeNumbers(0.2, 0.15, 0.08, 0.5),) * 2 + (BrakeNumbers(1.0, 1.0, 0.25, 0.5),), _ECM_SI_BUTTONS,
        mounting_pitch=ECM_SI_PITCH),
    **{(name, generation): _psm(generation, PSM3_SI_PITCH if name == "PSM3" else PSM_SI_PITCH)
       for name in ("PSM1", "PSM2", "PSM3") for generation in (CLASSIC, SI)},
}
NAMES: Final = tuple(dict.fromkeys(name for name, _ in ARMS))
BOARDS: Final = {"MTML": (0, 1), "MTMR": (2, 3), "ECM": (4, 5), "PSM1": (6, 7), "PSM2": (8, 9), "PSM3": (10, 11)}
"""Board ids of the arms, by their rotary switches."""
