"""The files in configs/ are enough by themselves and say what they should."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document import system as document

FULL_SCALE_A = 6.25
TORQUE_CONSTANT = 0.0438  # N·m/A
GEARS = (56.5, 56.5, 336.6, 11.71, 11.71, 11.71, 11.71)
COUNTS = (14400,) * 3 + (4000,) * 4


@pytest.fixture
def demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> document.SystemConfig:
    monkeypatch.chdir(tmp_path)
    loaded = load_system(PROJECT_CONFIGS / "systems/demo.yaml")
    assert loaded.errors == () and loaded.warnings == () and loaded.system is not None
    return loaded.system


def test_demo_needs_no_other_files(demo: document.SystemConfig) -> None:
    assert demo.name == "demo"
    arm = demo.arms[0]
    assert (arm.name, arm.tool_detection) == ("PSM1", "FIXED")
    assert arm.tool is not None and arm.tool.name == "LARGE_NEEDLE_DRIVER:400006"
    assert demo.emulation is not None
    assert demo.emulation.instruments == (("PSM1", "LARGE_NEEDLE_DRIVER:400006"),)
    sources = (arm.source, arm.chain.source, arm.tool.source, demo.ios[0].robots[0].source, demo.ios[0].pids[0].source)
    assert all(Path(source).is_relative_to(PROJECT_CONFIGS) for source in sources)


def test_gains_are_those_of_the_specification(demo: document.SystemConfig) -> None:
    axes = demo.ios[0].pids[0].axes
    assert [axis.p_gain for axis in axes] == [120, 120, 6000, 6, 6, 6, 6]
    assert [axis.d_gain for axis in axes] == [6, 5, 200, 0.09, 0.09, 0.09, 0.09]
    assert [axis.i_gain for axis in axes] == [0] * 7
    assert [axis.tolerance for axis in axes] == [0.5, 0.5, 0.05, 0.6, 0.6, 0.6, 0.6]
    assert {axis.pid_max_output for axis in axes} == {-1}
    assert {axis.v_low_pass_cutoff for axis in axes} == {1}
    assert not any(axis.use_disturbance_observer for axis in axes)


def test_scales_follow_from_gears_and_counts(demo: document.SystemConfig) -> None:
    for actuator, gear, counts in zip(demo.ios[0].robots[0].actuators, GEARS, COUNTS, strict=True):
        assert actuator.encoder is not None
        to_bits, from_bits = actuator.current_to_bits, actuator.bits_to_current
        sign = math.copysign(1.0, to_bits.scale)
        assert to_bits.scale == pytest.approx(sign * 32768 / FULL_SCALE_A, rel=1e-9)
        assert from_bits.scale == pytest.approx(sign * FULL_SCALE_A / 32768, rel=1e-9)
        assert actuator.effort_to_current == pytest.approx(1 / (gear * TORQUE_CONSTANT), rel=1e-7)
        assert actuator.encoder.bits_to_position.scale == pytest.approx(sign * 2 * math.pi / counts / gear, rel=1e-9)
        assert abs(from_bits.scale * to_bits.offset + from_bits.offset) < 0.05, "no current when none is asked for"


def test_current_limits_give_the_efforts_of_the_kinematic_file(demo: document.SystemConfig) -> None:
    actuators = demo.ios[0].robots[0].actuators
    for actuator, link in zip(actuators[:3], demo.arms[0].chain.links, strict=True):
        assert actuator.maximum_current / actuator.effort_to_current == pytest.approx(link.effort_max, rel=1e-5)
    for actuator in actuators[3:]:
        assert actuator.maximum_current / actuator.effort_to_current == pytest.approx(0.343642, rel=1e-5)


def test_potentiometers_see_the_whole_range(demo: document.SystemConfig) -> None:
    for actuator in demo.ios[0].robots[0].actuators:
        pot, encoder = actuator.potentiometer, actuator.encoder
        assert pot is not None and encoder is not None
        ends = sorted(pot.voltage_to_position.scale * volts + pot.voltage_to_position.offset for volts in (0.0, 4.5))
        assert ends[0] < encoder.lower < encoder.upper < ends[1]
        assert pot.bits_to_voltage.scale * 65536 == pytest.approx(4.5)


@pytest.mark.parametrize(("name", "network", "firmware", "fpga"), [
    ("testboard", "bridge", 8, "V2"), ("testboard-ethernet", "ethernet", 9, "V3")])
def test_boards_on_the_bench_start_alone(
        name: str, network: str, firmware: int, fpga: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    loaded = load_system(PROJECT_CONFIGS / f"systems/{name}.yaml")
    system = loaded.system
    assert loaded.warnings == () and system is not None and system.emulation is not None
    assert [(row.name, row.kind, row.after) for row in system.processes] == [
        ("boards", "boards", ()), ("system", "system", ())]
    assert system.ios == () and system.arms == () and document.from_json(document.to_json(system)) == system
    (bus,) = system.emulation.buses
    assert (bus.address, bus.network, bus.testboard) == ("0.0.0.0", network, True)
    assert [(c.board_id, c.hardware, c.firmware, c.fpga) for c in bus.controllers] == [
        (board, "QLA1", firmware, fpga) for board in (0, 1)]
    assert len({c.serial for c in bus.controllers}) == 2
