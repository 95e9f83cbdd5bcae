"""Consoles and teleoperations as the document has them: who drives whom, and which inputs the operator has.

Angles in rad, times in s; defaults are those of the original's `configure_parameter`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

SIMULATED: Final = "SIMULATED"
GOOVIS: Final = "PEDALS_GOOVIS_HEAD_SENSOR"


@dataclass(frozen=True, slots=True)
class TeleopPsmConfig:
    """One master on one slave; `base_frame_from` names the component, `base_frame_interface` what of it."""

    name: str
    mtm: str
    psm: str
    period_s: float
    console: str
    scale: float = 0.2
    rotation_locked: bool = False
    translation_locked: bool = False
    align_mtm: bool = True
    start_orientation_tolerance: float = math.radians(5.0)
    orientation_tolerance_after_clutch: float = math.radians(2.0)  # read, and of no effect in the original either
    start_gripper_threshold: float = math.radians(40.0)
    start_roll_threshold: float = math.radians(4.0)
    ignore_jaw: bool = False
    jaw_rate: float = 4.0 * math.pi  # rad/s
    jaw_rate_after_clutch: float = 0.2 * math.pi  # rad/s
    gripper_zero: float = 0.0
    gripper_max: float = math.radians(60.0)
    use_mtm_linear_velocity: bool = True
    use_mtm_angular_velocity: bool = False
    mtm_is_haptic: bool = True
    base_frame_from: str = ""
    base_frame_interface: str = ""
    wrench_timeout_s: float = 0.1  # a master's wrench that is not given again in that time ends; 0: never

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms that it works with."""
        return self.mtm, self.psm


@dataclass(frozen=True, slots=True)
class TeleopEcmConfig:
    """Two masters on the endoscope arm."""

    name: str
    mtml: str
    mtmr: str
    ecm: str
    period_s: float
    console: str
    scale: float = 0.2  # of the insertion only
    camera_roll_offset: float = 0.0

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms that it works with."""
        return self.mtml, self.mtmr, self.ecm


@dataclass(frozen=True, slots=True)
class WiredInput:
    """A digital input of an io."""

    io: str
    name: str


@dataclass(frozen=True, slots=True)
class Focus:
    """What moves the lens of an endoscope: digital outputs of an io, in and out, and the pedals for them."""

    name: str
    period_s: float
    io: str
    outputs: tuple[str, ...]
    pedals: tuple[WiredInput, ...]  # in, out; or none


@dataclass(frozen=True, slots=True)
class HidSensor:
    """A head sensor on USB: a byte of its newest report is not 0 while somebody looks."""

    vendor: int
    product: int
    index: int


@dataclass(frozen=True, slots=True)
class Console:
    """One place for an operator; without wired inputs it is reported by its emulate_* commands."""

    name: str
    input_type: str  # PEDALS_ONLY, PEDALS_ISI_HEAD_SENSOR, …, SIMULATED, COMPONENTS
    period_s: float
    teleops: tuple[str, ...] = ()  # those of the endoscope first, then the others as the file has them
    clutch: WiredInput | None = None
    camera: WiredInput | None = None
    operator_present: tuple[WiredInput, ...] = ()
    present_count: int = 1  # so many of them are needed
    turn_off: WiredInput | None = None  # a digital output: low, and the head sensor works
    head: HidSensor | None = None

    def is_wired_to(self, io: str) -> bool:
        """One of its inputs is a digital input of that io."""
        return any(wired is not None and wired.io == io for wired in (self.clutch, self.camera, *self.operator_present))
