"""Consoles and teleoperations in the document: masters, slaves, and the inputs of the operator.

Angles in rad, times in s; defaults are those of dVRK's `configure_parameter`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

SIMULATED: Final = "SIMULATED"
GOOVIS: Final = "PEDALS_GOOVIS_HEAD_SENSOR"


@dataclass(frozen=True, slots=True)
class TeleopPsmConfig:
    """Teleoperation of one slave by one master; `base_frame_from` is the component, `base_frame_interface` its part."""

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
    orientation_tolerance_after_clutch: float = math.radians(2.0)  # read, but without effect, as in the original
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
    wrench_timeout_s: float = 0.1  # a master's wrench ends unless it is repeated within this time; 0: never

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms that it works with."""
        return self.mtm, self.psm


@dataclass(frozen=True, slots=True)
class TeleopEcmConfig:
    """Teleoperation of the endoscope arm by two masters."""

    name: str
    mtml: str
    mtmr: str
    ecm: str
    period_s: float
    console: str
    scale: float = 0.2  # of the insertion only
    camera_roll_offset: float = 0.0
    check_mtms_workspace: bool = True  # both masters must be in view of the camera's frame to begin

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
    """The drive of an endoscope's lens: digital outputs of an io for in and out, and their pedals."""

    name: str
    period_s: float
    io: str
    outputs: tuple[str, ...]
    pedals: tuple[WiredInput, ...]  # in, out; or none


@dataclass(frozen=True, slots=True)
class HidSensor:
    """A head sensor on USB: a byte of its newest report is not 0 while an operator looks into the console."""

    vendor: int
    product: int
    index: int


@dataclass(frozen=True, slots=True)
class Console:
    """One operator's console; without wired inputs, its inputs are set by emulate_* commands."""

    name: str
    input_type: str  # PEDALS_ONLY, PEDALS_ISI_HEAD_SENSOR, …, SIMULATED, COMPONENTS
    period_s: float
    teleops: tuple[str, ...] = ()  # those of the endoscope first, then the others in the order of the file
    clutch: WiredInput | None = None
    camera: WiredInput | None = None
    operator_present: tuple[WiredInput, ...] = ()
    present_count: int = 1  # number of these inputs that must be active
    turn_off: WiredInput | None = None  # a digital output; the head sensor works while it is low
    head: HidSensor | None = None

    def is_wired_to(self, io: str) -> bool:
        """Whether one of its inputs is a digital input of that io."""
        return any(wired is not None and wired.io == io for wired in (self.clutch, self.camera, *self.operator_present))
