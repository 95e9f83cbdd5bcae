"""THE TABLE of arm types: number of joints, limits, inertia, and the modules that implement them.

Inertia and friction, which stock files lack, are for emulated boards. PSM Classic, first three joints: fitted to 30 s
of a real arm (efforts recorded while all joints were excited). Yaw shows 0.073 kg·m² plus 0.12·cos²(pitch), as of a
long body across the shaft, which pitch turns as well; so the table has that share as the shaft's inertia, and the rest,
the motors' share, as armature. The other rows are chosen by the rule of `trocar.procs.boards.robots.mechanics` and the
size of the arm, not measured.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class TrajectoryLimits:
    """Maximum velocity and acceleration of joint trajectories at ratio 1, per joint: rad/s or m/s, rad/s² or m/s².

    `arrival`: distance within which a joint has reached the goal of a move or of homing, rad or m.
    """

    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    arrival: tuple[float, ...]

    def scaled(self, velocity_ratio: float = 1.0, acceleration_ratio: float = 1.0) -> tuple[Array, Array]:
        """(velocity, acceleration) as new arrays (n,), multiplied by the ratios, which a person may set."""
        return velocity_ratio * np.array(self.velocity), acceleration_ratio * np.array(self.acceleration)


@dataclass(frozen=True, slots=True)
class ServoLimits:
    """Limits of streamed setpoints per joint, see `trocar.procs.arm.governor`: rad/s or m/s, rad/s² or m/s²."""

    speed: tuple[float, ...]
    acceleration: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class EffortModeLimits:
    """Limits in effort mode per joint: rad/s or m/s, rad or m.

    `speed`: a joint at this speed is not driven further, and a faster one is braked. `zone`: distance from a position
    limit at which the soft wall begins.
    """

    speed: tuple[float, ...]
    zone: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class JointInertia:
    """Armature (kg·m² or kg), viscous friction (N·m·s/rad or N·s/m) and Coulomb friction (N·m or N)."""

    armature: float
    viscous: float
    coulomb: float


@dataclass(frozen=True, slots=True)
class ArmInertia:
    """One arm type's inertia, a row per joint of its kinematic file, and its position when boards are switched on."""

    joints: tuple[JointInertia, ...]
    initial: tuple[float, ...]  # actuator positions, rad or m
    shaft: tuple[float, float, float] = (0.0, 0.0, 0.0)  # kg·m² about x y z of the insertion link, z along the shaft
    homed_at_stop: int = -1  # the joint that the host homes at its lower stop, which is at the file's lower limit


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmType:
    """One arm type. Its implementations are named as module:name and imported on use, see `found`.

    `joints`: number of the arm's own joints; further `actuators` drive an instrument. `gains`: stock PID files by
    generation. `moves`, `servo` and `efforts` limit each joint; `kinematic_home` is the home position of a KINEMATIC
    arm, rad or m. `views` (first words of names) and `events` are those that only some types have. Without an
    `inverse` there are no Cartesian goals. For `physical`, the links with masses of a generation, see
    `trocar.procs.config.loading.chains`; `plant` is its emulated robot by generation, whose axes are loose without one.
    """

    actuators: int
    joints: int
    gains: Mapping[str, str]
    moves: TrajectoryLimits
    servo: ServoLimits
    efforts: EffortModeLimits
    kinematic_home: tuple[float, ...]
    arm_file: str = "trocar.procs.config.models.arm_file:ArmFile"
    process: str = "trocar.procs.arm.arm:ArmLogic"
    client: str = "trocar.tools.client.arm:Arm"
    inverse: str = ""
    views: tuple[str, ...] = ()
    events: tuple[str, ...] = ()
    has_endoscope: bool = False
    physical: Mapping[str, str] = field(default_factory=dict)
    physical_links: tuple[int, ...] = ()
    parallelogram: tuple[tuple[int, float] | None, ...] = ()
    """The joint that moves each physical link of an Si arm, and its share; None: the link does not move."""
    plant: Mapping[str, ArmInertia] = field(default_factory=dict)

    @property
    def max_speeds(self) -> tuple[float, ...]:
        """io's speed limits for actuator setpoints: twice those of streams; for discs, that of their fastest joint."""
        own, discs = self.servo.speed[: self.joints], self.servo.speed[self.joints :]
        return (*(2.0 * speed for speed in own), *(2.0 * max(discs, default=0.0),) * len(discs))

    @property
    def has_remote_centre(self) -> bool:
        """Whether its instrument or endoscope moves about a remote centre: PSM, ECM."""
        return self.joints < self.actuators or self.has_endoscope

    @property
    def has_gripper(self) -> bool:
        """Whether it has a master's gripper, which is a separate robot in IO files."""
        return "gripper" in self.views


def base_name(arm: str) -> str:
    """Name of the frame of an arm's base, in which its local poses are."""
    return f"{arm}_base"


def found(name: str) -> object:
    """The object that the table names as module:name."""
    module, _, what = name.partition(":")
    thing: object = getattr(importlib.import_module(module), what)
    return thing


def class_of(name: str, kind: type[T]) -> type[T]:
    """The class named as module:name; TypeError unless it is a subclass of `kind`."""
    thing = found(name)
    if not (isinstance(thing, type) and issubclass(thing, kind)):
        raise TypeError(f"{name} is no {kind.__name__}")
    return thing


PSM_INITIAL: Final = (0.05, -0.08, 0.10, 0.2, 0.2, 0.2, 0.2)

# Servo: above the sample-to-sample motion of real arms in recordings with all joints excited (a PSM's insertion up to
# 0.39 m/s; a master's roll 26 rad/s, and twice that at a late sample), and above the limits of moves. In 0.1 s a PSM's
# yaw, pitch and insertion move less than their allowed tracking errors.
# Efforts: the speed of the arm itself or of a hand in ordinary use, and no more; zones in which the joint's own motor
# can stop it from that speed: longer than speed² · inertia / effort. Homes: instrument or endoscope inserted, so that
# the tip can be moved from there on. Arrival: dVRK homing tolerances, which real arms meet; less for prismatic joints.
# With recorded efforts and stock gains, a PSM's errors are 0.8° and 0.4 mm at most.
ARM_TYPES: Final[Mapping[str, ArmType]] = {
    "PSM": ArmType(  # yaw, pitch, insertion, four discs (or roll, wrist pitch, wrist yaw, jaw)
        actuators=7,
        joints=3,
        arm_file="trocar.procs.config.models.arm_file:PsmFile",
        process="trocar.procs.arm.psm.psm:PsmLogic",
        client="trocar.tools.client.kinds:Psm",
        inverse="trocar.procs.kinematics.inverse.arms:instrument_inverse",
        gains={"Classic": "pid/sawControllersPID-PSM.json", "Si": "pid/sawControllersPID-PSM-Si.json"},
        moves=TrajectoryLimits(
            velocity=(radians(90), radians(90), 0.2, *(radians(1080),) * 4),
            acceleration=(radians(90), radians(90), 0.2, *(radians(720),) * 4),
            arrival=(radians(3), radians(3), 0.005, *(radians(3),) * 4),
        ),
        servo=ServoLimits((2.2, 2.2, 0.45, 20.0, 10.0, 10.0, 15.0), (300.0, 300.0, 60.0, *(400.0,) * 4)),
        # Yaw, pitch: as in moves. Insertion: more, as a hand with the clutch moves faster. Wrist: less than in moves,
        # from which a short zone could not stop it; the tip then moves at 60 mm/s.
        efforts=EffortModeLimits((radians(90), radians(90), 0.3, radians(720), *(radians(360),) * 3),
                                 (0.15, 0.15, 0.010, *(0.15,) * 4)),
        kinematic_home=(0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0),
        views=("jaw",),
        events=("tool_type", "tool_type_request", "arm_clutch"),
        physical={"Si": "kinematic/PSM_Si_physical.json"},  # a Classic is counter-balanced
        physical_links=(7,),
        parallelogram=((0, 1.0), None, (1, 1.0), (1, -1.0), (1, 1.0), (2, 0.5), (2, 0.5)),
        plant={
            "Classic": ArmInertia(
                joints=(JointInertia(0.073, 0.11, 0.05), JointInertia(0.04, 0.21, 0.06), JointInertia(0.57, 1.5, 0.39)),
                initial=PSM_INITIAL,
                shaft=(0.12, 0.12, 0.002),
            ),
            "Si": ArmInertia(
                joints=(JointInertia(0.20, 0.5, 0.2), JointInertia(0.20, 0.5, 0.2), JointInertia(0.80, 3.0, 1.0)),
                initial=PSM_INITIAL,
                shaft=(0.12, 0.12, 0.002),
            ),
        },
    ),
    "MTM": ArmType(  # six joints, then roll
        actuators=7,
        joints=7,
        arm_file="trocar.procs.config.models.arm_file:MtmFile",
        process="trocar.procs.arm.mtm.mtm:MtmLogic",
        client="trocar.tools.client.kinds:Mtm",
        inverse="trocar.procs.kinematics.inverse.arms:master_inverse",
        gains=dict.fromkeys(("Classic", "Si"), "pid/sawControllersPID-MTM.json"),
        moves=TrajectoryLimits(
            velocity=(*(radians(90),) * 6, radians(360)),
            acceleration=(*(radians(45),) * 6, radians(360)),
            arrival=(*(radians(4),) * 6, radians(6)),
        ),
        servo=ServoLimits((8.0, 8.0, 5.0, 20.0, 30.0, 8.0, 60.0),
                          (1600.0, 1600.0, 1000.0, 4000.0, 6000.0, 1600.0, 12000.0)),
        # A surgeon's hand must feel neither: 120°/s of the outer joints is 0.8 m/s at the handle, and working hands
        # reach 0.5 m/s; wrists turn at up to 300°/s, and fingers roll faster.
        efforts=EffortModeLimits((*(radians(120),) * 3, radians(180), radians(360), radians(360), radians(720)),
                                 (*(0.2,) * 3, 0.15, 0.25, 0.2, 1.0)),
        kinematic_home=(0.0,) * 7,
        views=("gripper",),
        events=("gripper/closed", "gripper/pinch", "orientation_locked"),
        plant={
            "Classic": ArmInertia(
                joints=(
                    JointInertia(0.080, 0.10, 0.04),
                    JointInertia(0.060, 0.10, 0.04),
                    JointInertia(0.040, 0.06, 0.03),
                    JointInertia(0.0050, 0.01, 0.01),
                    JointInertia(0.0008, 0.002, 0.002),
                    JointInertia(0.0006, 0.001, 0.002),
                    JointInertia(0.0002, 0.0004, 0.001),
                ),
                initial=(0.05, 0.10, 0.05, 0.1, 0.1, 0.05, 0.2),
                homed_at_stop=6,
            ),
        },
    ),
    "ECM": ArmType(  # yaw, pitch, insertion, roll
        actuators=4,
        joints=4,
        arm_file="trocar.procs.config.models.arm_file:EcmFile",
        process="trocar.procs.arm.ecm:EcmLogic",
        client="trocar.tools.client.kinds:Ecm",
        inverse="trocar.procs.kinematics.inverse.arms:endoscope_inverse",
        gains={"Classic": "pid/sawControllersPID-ECM.json", "Si": "pid/sawControllersPID-ECM-Si.json"},
        moves=TrajectoryLimits(
            velocity=(radians(30), radians(30), 0.06, radians(30)),
            acceleration=(radians(90), radians(90), 0.06, radians(90)),
            arrival=(radians(3), radians(3), 0.005, radians(3)),
        ),
        servo=ServoLimits((1.6, 1.6, 0.25, 3.2), (100.0, 100.0, 20.0, 200.0)),
        # At least twice that of moves, whose limits are for a sharp picture, not for a hand with the clutch.
        efforts=EffortModeLimits((radians(60), radians(60), 0.12, radians(180)), (0.15, 0.15, 0.010, 0.15)),
        kinematic_home=(0.0, 0.0, 0.12, 0.0),
        events=("endoscope_type", "arm_clutch"),
        has_endoscope=True,
        physical={"Si": "kinematic/ECM_Si_physical.json", "Classic": "kinematic/ECM.json"},
        physical_links=(6, 4),
        parallelogram=((0, 1.0), None, (1, 1.0), (1, -1.0), (1, 1.0), (2, 1.0)),
        plant={
            "Classic": ArmInertia(
                joints=(
                    JointInertia(0.60, 1.5, 1.0),
                    JointInertia(0.60, 1.5, 1.0),
                    JointInertia(4.0, 20.0, 5.0),
                    JointInertia(0.004, 0.02, 0.02),
                ),
                initial=(0.05, -0.05, 0.08, 0.1),
                shaft=(0.15, 0.15, 0.004),
            ),
            "Si": ArmInertia(
                joints=(
                    JointInertia(0.60, 1.5, 1.0),
                    JointInertia(0.60, 1.5, 1.0),
                    JointInertia(3.0, 20.0, 5.0),
                    JointInertia(0.012, 0.05, 0.05),
                ),
                initial=(0.05, -0.05, 0.08, 0.1),
                shaft=(0.15, 0.15, 0.004),
            ),
        },
    ),
}
