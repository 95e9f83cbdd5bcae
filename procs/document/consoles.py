"""Consoles and teleoperations in the document: masters, slaves, and the inputs of the operator.

Angles in rad, times in s. Fields with a `Key` are those of `configure_parameter`, with the dVRK's defaults.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from trocar.procs.document.keys import Key

SIMULATED: Final = "SIMULATED"
GOOVIS: Final = "PEDALS_GOOVIS_HEAD_SENSOR"
Scale = Annotated[float, Key(0.0, 1.0, above=True)]
Switch = Annotated[bool, Key()]
Tolerance = Annotated[float, Key(0.0)]
Rate = Annotated[float, Key(0.0, above=True)]


@dataclass(frozen=True, slots=True)
class TeleopPsmConfig:
    """Teleoperation of one slave by one master; `base_frame_from` is the component, `base_frame_interface` its part."""

    name: str
    mtm: str
    psm: str
    period_s: float
    console: str
    scale: Scale = 0.2
    rotation_locked: Switch = False
    translation_locked: Switch = False
    align_mtm: Annotated[bool, Key(name="align_MTM")] = True
    start_orientation_tolerance: Tolerance = 0.0872665
    orientation_tolerance_after_clutch: Tolerance = 0.0349066  # read, but without effect, as in the original
    start_gripper_threshold: Tolerance = 0.6981317
    start_roll_threshold: Tolerance = 0.0698132
    ignore_jaw: Switch = False
    jaw_rate: Rate = 12.5663706  # rad/s
    jaw_rate_after_clutch: Rate = 0.6283185  # rad/s
    gripper_zero: float = 0.0
    gripper_max: float = 1.0471976
    use_mtm_linear_velocity: Annotated[bool, Key(name="use_MTM_linear_velocity")] = True
    use_mtm_angular_velocity: Annotated[bool, Key(name="use_MTM_angular_velocity")] = False
    mtm_is_haptic: Annotated[bool, Key(name="MTM_is_haptic")] = True
    base_frame_from: str = ""
    base_frame_interface: str = ""
    wall_force: float = 0.0  # N, see ArmConfig
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
    scale: Annotated[float, Key(0.0, 1.0, "of the insertion", above=True)] = 0.2
    camera_roll_offset: Annotated[float, Key(text="rad")] = 0.0
    # Both masters must be in view of the camera's frame to begin.
    check_mtms_workspace: Annotated[bool, Key(name="check_MTMs_workspace")] = True

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
