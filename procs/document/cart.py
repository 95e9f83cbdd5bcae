"""Setup joints in the document: a patient cart whose setup arms carry arms of the system.

World · FK(q) · tip of a setup arm is the base frame of the carried arm, relative to the cart.
"""

from __future__ import annotations

from dataclasses import dataclass

from trocar.procs.document.arms import Chain, Matrix

Linear = tuple[float, float]  # scale, offset
CLASSIC, SI, FIXED = "Classic", "Si", "Fixed"
MULTIPLEXER_OUTPUTS = ("no_mux_reset", "mux_increment")
LIFT_OUTPUTS = ("control_PWM", "disable_PWM")
"""Names of outputs of a Classic cart's interface board, the same in every IO file."""
SETUP_BRAKE = "SUJ_brake"
"""The brakes of the setup joints under an Si arm are the output NAME_SUJ_brake of that arm's controllers."""


@dataclass(frozen=True, slots=True)
class CartArm:
    """One setup arm; the first joint is prismatic (m), the others turn (rad)."""

    name: str
    carries: str = ""  # the system's arm whose base frame it determines
    chain: Chain | None = None  # fixed ones have none
    joints: int = 0  # with potentiometers; the remaining joints of the chain are 0
    world: Matrix | None = None  # world_origin_to_SUJ, 4×4
    tip: Matrix | None = None  # SUJ_tip_to_tool_origin, 4×4
    position: tuple[float, ...] = ()  # KINEMATIC: initial position
    pose: Matrix | None = None  # fixed: of the carried arm's base in the cart, 4×4
    primary: tuple[Linear, ...] = ()  # volts (Si: counts) to position, by joint
    secondary: tuple[Linear, ...] = ()
    weight: tuple[float, ...] = ()  # of the primary ones, 0 to 1
    plug: int = 0  # Classic: 1 to 4
    release_current: float = 0.0  # A; releases Classic brakes
    engaged_current: float = 0.0  # A
    lifts: bool = False  # Classic: a motor moves the first joint
    board: str = ""  # Si: Bluetooth address of its potentiometer board; its own name where there is none
    base_pot: int = 0  # Si: number of its first joint's potentiometer on the base's board


@dataclass(frozen=True, slots=True)
class Cart:
    """One `arms[]` entry of type SUJ_Classic, SUJ_Si or SUJ_Fixed with its file."""

    name: str
    kind: str  # Classic, Si or Fixed
    simulation: str  # NONE or KINEMATIC
    period_s: float
    arms: tuple[CartArm, ...]
    reference: str = "ECM"  # the others' base frames are relative to the tip of the arm on this setup arm
    io: str = ""  # Classic: instance of the io process of its interface board
    robot: str = ""  # its robot in that io: an analog input and a current for every plug
    base_board: str = ""  # Si: Bluetooth address of the base's potentiometer board
    emulated: bool = False  # Si: its potentiometer boards are emulated
    by_arm: bool = False  # Si of 2026: the controller of each carried arm reads all joints of its setup arm
    source: str = ""


def channel_inputs(robot: str, lines: int = 4) -> tuple[str, ...]:
    """Names of the digital inputs with the channel of a Classic cart's multiplexer, lowest bit first."""
    return tuple(f"{robot}_channel_{line}" for line in range(lines))
