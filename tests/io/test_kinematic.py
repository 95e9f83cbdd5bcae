"""KINEMATIC robots on a stepped clock: no boards, and otherwise like the others."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.harness import FakeCommand, FakeSource, SteppedClock
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import IoConfig
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.kinematic import kinematic_io
from trocar.procs.io.record import IoRecord
from trocar.procs.io.setpoint_tracker import DRIVE
from trocar.procs.kinematics.trajectory import Trajectory
from trocar.procs.tables.arm_types import ARM_TYPES

PERIOD_NS = 1_000_000
SEVEN = (0.1, -0.2, 0.15, 0.3, 0.1, -0.1, 0.2)


def document() -> IoConfig:
    system = load_system(PROJECT_CONFIGS / "systems/kinematic.yaml").system
    assert system is not None
    return system.io("io")


class KinematicStage:
    """The robot of the newcomers' file, its arm and a clock."""

    def __init__(self, record: IoRecord | None = None) -> None:
        self.io, self.clock, self.arm = document(), SteppedClock(), FakeSource()
        self.record = record or IoRecord.private(7, 1, 0)
        self.alive = True
        self.core = kinematic_io(IoContext(self.io, self.clock, self.record, [self.arm]))

    def run(self, cycles: int = 1, *commands: FakeCommand) -> None:
        for _ in range(cycles):
            self.clock.ns += PERIOD_NS
            if self.alive:
                self.arm.stamp_ns = self.clock.ns - 100_000
                self.arm.bias_generation[...] = self.record.bias_generation[0]
                self.arm.pid_generation[...] = self.record.pid_generation[0]
            self.core.cycle(commands)
            commands = ()

    def ask(self, name: str, *values: float) -> FakeCommand:
        command = FakeCommand(name, "PSM1", *values)
        self.run(1, command)
        return command

    def power(self) -> None:
        command = self.ask("power_on")
        self.run(3)
        assert command.outcome == "done"

    def send(self, mode: int = DRIVE, **arrays) -> None:
        self.arm.mode[...] = mode
        for name, values in arrays.items():
            getattr(self.arm, name)[: len(values)] = values

    @property
    def texts(self) -> list[str]:
        return [event.text for event in self.core.reports.events]

    @property
    def codes(self) -> list[str]:
        return [event.code for event in self.core.reports.events if event.kind == "error"]


@pytest.fixture
def stage() -> KinematicStage:
    return KinematicStage()


@pytest.fixture
def powered(stage: KinematicStage) -> KinematicStage:
    stage.power()
    assert stage.ask("pid_enable", 1).outcome == "done"
    return stage


def test_power_is_on_within_three_cycles_with_the_joints_at_zero() -> None:
    record = IoRecord.private(7, 1, 0)
    record.position[...] = SEVEN
    stage = KinematicStage(record)
    command = stage.ask("power_on")
    assert tuple(record.position) == SEVEN and not record.powered[0]
    stage.run(3)
    assert command.answers[-1][0] == "done"
    assert record.powered[0] and record.amps_on[0] and not record.pid_enabled[0] and not record.tracking_check[0]
    assert not record.position.any() and not record.setpoint_position.any() and not record.velocity.any()


def test_power_again_puts_the_joints_to_zero_and_a_second_power_on_does_not(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.run()
    powered.power()
    assert tuple(powered.record.position) == SEVEN, "it has power already"
    assert powered.ask("power_off").outcome == "done"
    powered.power()
    assert not powered.record.position.any()


def test_record_says_that_it_is_played_and_makes_nothing_up(powered: KinematicStage) -> None:
    record = powered.record
    assert record.simulated[0] and record.valid and record.biased[0] and record.bias_generation[0] == 1
    for name in ("current", "current_request", "temperature", "pot_position", "pot_voltage", "firmware_velocity"):
        assert np.isnan(getattr(record, name)).all(), name
    assert record.relay[0] and record.amp_on.all() and record.amp_enabled.all(), "as commanded"
    assert not record.watchdog[0] and not record.power_fault[0] and not record.bad_reads
    assert np.isnan(record.board_period[0]) and not record.effort.any()
    assert any("KINEMATIC" in text for text in powered.texts)


def test_measured_position_is_the_setpoint_of_the_same_cycle(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.run()
    assert tuple(powered.record.position) == SEVEN and tuple(powered.record.setpoint_position) == SEVEN
    assert not powered.record.position_error.any()


def test_velocity_is_the_step_over_the_time_between_setpoints(powered: KinematicStage) -> None:
    powered.run(3)
    powered.send(position=np.full(7, 0.002))
    powered.run()
    assert powered.record.velocity == pytest.approx(np.full(7, 0.002 / 1e-3))
    powered.alive = False  # no newer one for three cycles, then one that is 4 ms younger
    powered.run(3)
    assert powered.record.velocity == pytest.approx(np.full(7, 2.0)), "as it was, the newest is not 20 ms old"
    powered.alive = True
    powered.send(position=np.full(7, 0.003))
    powered.run()
    assert powered.record.velocity == pytest.approx(np.full(7, 0.001 / 4e-3))


def test_velocity_is_zero_when_the_newest_setpoint_is_20_ms_old(powered: KinematicStage) -> None:
    powered.run(3)
    powered.send(position=np.full(7, 0.002))
    powered.run()
    powered.alive = False
    powered.run(19)
    assert powered.record.velocity.all()
    powered.run()
    assert not powered.record.velocity.any()


def test_joints_in_effort_mode_stay_and_their_velocity_is_zero(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.run()
    powered.send(position=np.zeros(7), effort=np.ones(7), in_effort=np.ones(7, dtype=bool))
    powered.run(5)
    assert powered.record.effort_mode.all() and tuple(powered.record.position) == SEVEN
    assert not powered.record.velocity.any()
    assert powered.record.setpoint_effort == pytest.approx(np.ones(7)) and not powered.record.effort.any()


def test_a_slow_loop_is_no_fault_of_a_robot_that_needs_no_control(powered: KinematicStage) -> None:
    for _ in range(500):  # 3 s, at a fraction of the rate
        powered.clock.ns += 5 * PERIOD_NS
        powered.run()
    assert powered.codes == [] and powered.record.powered[0] and powered.record.pid_enabled[0]


def test_disabled_robot_holds_its_position(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.run()
    assert powered.ask("power_off").outcome == "done"
    powered.send(position=np.zeros(7))
    powered.run(5)
    assert tuple(powered.record.position) == SEVEN and not powered.record.velocity.any()
    assert not powered.record.powered[0] and not powered.record.pid_enabled[0]


def test_dead_arm_leaves_it_holding_and_is_reported(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.run()
    powered.alive = False
    powered.run(40)
    assert powered.record.holding[0] and tuple(powered.record.position) == SEVEN
    powered.clock.ns += 3_000_000_000
    powered.run(3)
    assert powered.codes == ["arm-lost"] and powered.record.pid_enabled[0] and powered.record.powered[0]
    powered.alive = True
    powered.run()
    assert not powered.record.holding[0] and tuple(powered.record.position) == SEVEN


def test_setpoints_for_another_enable_are_not_followed(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.alive = False
    powered.arm.stamp_ns = powered.clock.ns
    powered.arm.pid_generation[...] = powered.record.pid_generation[0] - 1
    powered.run()
    assert not powered.record.position.any()


def test_setpoints_are_clipped_to_the_limits_of_the_chain(powered: KinematicStage) -> None:
    assert powered.ask("enforce_limits", 1).outcome == "done"
    powered.send(position=(9.0, -9.0, 9.0, 9.0, 0.0, 0.0, 0.0))
    powered.run()
    assert powered.record.position == pytest.approx((1.588, -0.925025, 0.24, 3.001966, 0, 0, 0), abs=1e-6)
    assert powered.record.at_limit.tolist() == [True] * 4 + [False] * 3


def test_tracking_check_finds_nothing_where_nothing_lags(powered: KinematicStage) -> None:
    assert powered.ask("tracking_check", 1).outcome == "done"
    powered.send(position=SEVEN)
    powered.run(3)
    assert powered.codes == [] and powered.record.pid_enabled[0] and powered.record.tracking_check[0]


def test_setpoint_that_is_not_a_number_switches_off(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.run()
    powered.send(position=(np.nan,) * 7)
    powered.run()
    assert powered.codes == ["not-finite"] and not powered.record.pid_enabled[0]
    assert tuple(powered.record.position) == SEVEN


@pytest.mark.parametrize(
    ("name", "values", "reason"),
    [("bias_encoders", (100.0,), "it is KINEMATIC: its positions are exact"),
     ("set_encoder", (6.0, 0.0), "it is KINEMATIC: its positions are exact"),
     ("drive_axis", (0.0, 0.1, 1.0, 0.1, 0.0), "it is KINEMATIC: it has no motors"),
     ("supply_on", (1.0,), "it is KINEMATIC: it has no supply"),
     ("brake_release", (), "no brakes"), ("brake_engage", (), "no brakes"), ("set_output", (1.0,), "none"),
     *((name, (0.0,), "KINEMATIC") for name in ("lift", "setup_brake", "multiplexer"))],
)
def test_what_needs_hardware_is_refused_with_the_reason(powered: KinematicStage, name: str, values,
                                                        reason: str) -> None:
    command = powered.ask(name, *values)
    assert command.outcome == "refused" and reason in command.answers[-1][1]


def test_gains_are_shown_as_zero_and_cannot_be_changed(powered: KinematicStage) -> None:
    command = FakeCommand("set_gains", "PSM1 p_gain", -1.0, 5.0)
    powered.run(1, command)
    assert command.outcome == "refused" and "KINEMATIC" in command.answers[-1][1]
    assert not powered.core.parts.gains.record["p_gain"].any()


def test_restarted_io_finds_the_robot_where_it_was_without_power(powered: KinematicStage) -> None:
    powered.send(position=SEVEN)
    powered.run()
    before = int(powered.record.pid_generation[0])
    again = KinematicStage(powered.record)
    again.run()
    assert tuple(again.record.position) == SEVEN and not again.record.powered[0]
    assert again.record.pid_generation[0] > before and again.record.bias_generation[0] == 2


@pytest.mark.parametrize(("family", "seconds"), [("PSM", 1.549), ("ECM", 3.0), ("MTM", 0.0)])
def test_homing_from_zero_takes_as_long_as_in_the_reference(family: str, seconds: float) -> None:
    goal = np.array(ARM_TYPES[family].kinematic_home)
    move = Trajectory(len(goal))
    assert move.start(np.zeros_like(goal), np.zeros_like(goal), goal, *ARM_TYPES[family].moves.scaled(), 0.0) is None
    assert move.duration == pytest.approx(seconds, abs=5e-4)
