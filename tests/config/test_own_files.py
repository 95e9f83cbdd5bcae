"""Our own files for every kind of arm: they load by themselves, and say what the stock files say."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

from tests import stock
from tests.cases import cases
from trocar.procs.config import PROJECT_CONFIGS, check_file, load_system
from trocar.procs.config.loading.chains import load_chain, load_tool
from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.io_file import PidFile
from trocar.procs.config.read.search import search_path
from trocar.procs.document import system as document

ARMS = {  # of every system: names, types, generations
    "demo": (("PSM1", "PSM", "Classic"),),
    "demo-psm-si": (("PSM1", "PSM", "Si"),),
    "demo-ecm": (("ECM", "ECM", "Classic"),),
    "demo-ecm-si": (("ECM", "ECM", "Si"),),
    "demo-mtm": (("MTML", "MTM", "Classic"), ("MTMR", "MTM", "Classic")),
}
SYSTEMS = {**ARMS, **{name.replace("demo", "kinematic"): arms for name, arms in ARMS.items()}}
CHAINS = ("PSM", "PSM_Si", "PSM_Si_physical", "ECM", "ECM_Si", "ECM_Si_physical", "MTML", "MTMR")
TOOLS = ("LARGE_NEEDLE_DRIVER_400006", "LARGE_NEEDLE_DRIVER_420006")
GAINS = {"PSM": 7, "PSM-Si": 7, "ECM": 4, "ECM-Si": 4, "MTM": 7}


def bodies(name: str) -> document.SystemConfig:
    """A system of ours as its robots are, alone on the search path."""
    loaded = load_system(PROJECT_CONFIGS / f"systems/{name}.yaml", search=[], configs=PROJECT_CONFIGS)
    assert (loaded.errors, loaded.warnings) == ((), ())
    assert loaded.system is not None
    return loaded.system


def own(name: str) -> list[document.ArmConfig]:
    """The arms of a system of ours."""
    return [bodies(name).emulated().arm(arm) for arm, *_ in SYSTEMS[name]]


@cases("name", SYSTEMS)
def test_every_kind_of_arm_has_a_system_of_its_own(name: str) -> None:
    system = bodies(name)
    kinds = [row.kind for row in system.processes]
    assert kinds[:2] == ["boards", "io"] if name.startswith("demo") else kinds[0] == "io"
    robots = {robot.name: robot for io in system.ios for robot in io.robots}
    for arm, kind, _ in SYSTEMS[name]:
        assert len(robots[arm].actuators) == (4 if kind == "ECM" else 7)
        assert kind != "MTM" or name.startswith("kin") or len(robots[f"{arm}_gripper"].actuators) == 1
    assert document.from_json(document.to_json(system)) == system


@pytest.mark.slow
def test_every_file_of_ours_is_checked_without_a_word() -> None:
    for path in sorted(PROJECT_CONFIGS.rglob("*.yaml")):
        assert check_file(path).problems == (), path


@pytest.mark.parametrize("name", [name for name in SYSTEMS if name.startswith("demo")])
def test_arms_of_ours_have_what_their_kind_needs(name: str) -> None:
    for arm, (_, kind, generation) in zip(own(name), SYSTEMS[name], strict=True):
        assert (arm.type, arm.generation) == (kind, generation)
        weighs = (kind, generation) in {("PSM", "Si"), ("ECM", "Si"), ("ECM", "Classic")}
        assert (arm.links is not None) == weighs
        if kind == "PSM":
            assert arm.tool is not None and arm.inputs.tool == "PSM1_tool" and arm.instrument_reader == "PSM1_dallas"
        if kind == "ECM":
            assert arm.endoscope and arm.mounting_pitch and arm.inputs.clutch == "ECM_arm_clutch"
        if kind == "MTM":
            assert arm.gripper == f"{arm.name}_gripper" and arm.master_gravity is None and arm.homing_zero_position


@cases("name", CHAINS)
def test_our_chains_equal_the_stock_ones(name: str) -> None:
    ours = _chain(PROJECT_CONFIGS / f"kinematic/{name}.yaml")
    theirs = _chain(stock.find(f"dvrk-share/kinematic/{name}.json"))
    assert dataclasses.replace(ours, source="") == dataclasses.replace(theirs, source="")


@pytest.mark.parametrize("name", GAINS)
def test_our_gains_equal_the_stock_ones(name: str) -> None:
    ours = _gains(PROJECT_CONFIGS / f"pid/{name}.yaml")
    assert len(ours) == GAINS[name]
    assert ours == _gains(stock.find(f"dvrk-share/pid/sawControllersPID-{name}.json"))


@pytest.mark.parametrize("name", TOOLS)
def test_our_instruments_equal_the_stock_ones(name: str) -> None:
    ours = _tool(PROJECT_CONFIGS / f"tool/{name}.yaml")
    assert ours == _tool(stock.find(f"dvrk-share/tool/{name}.json"))


@pytest.mark.parametrize("name", [name for name in SYSTEMS if name.startswith("demo")])
def test_scales_of_our_controllers_are_what_they_are_made_of(name: str) -> None:
    for robot in (robot for io in bodies(name).ios for robot in io.robots):
        for part in (*robot.actuators, *robot.brakes):
            product = part.current_to_bits.scale * part.bits_to_current.scale
            assert math.isclose(product, 1.0, rel_tol=1e-6)
            assert abs(part.current_to_bits.scale) in (5242.88, 4800.0, 16000.0)
        wanted = {"QLA1"} if "si" not in name.split("-") else {"dRA1"}
        assert {robot.hardware} == wanted


def test_a_table_may_say_what_it_spreads_over(tmp_path: Path) -> None:
    (robot,) = bodies("demo-ecm-si").ios[0].robots
    assert robot.potentiometers == "DIGITAL" and robot.lookup
    text = (PROJECT_CONFIGS / "io/ECM-Si-demo-potentiometers.yaml").read_text()
    (tmp_path / "ECM-Si-demo.yaml").write_text((PROJECT_CONFIGS / "io/ECM-Si-demo.yaml").read_text())
    for wrong in ("{from: -2.99}", "{from: a, to: 1}", "{from: true, to: 1}", "{from: 0, to: 99}"):
        spoilt = text.replace("{from: -2.99, to: 2.99}", wrong)
        (tmp_path / "ECM-Si-demo-potentiometers.yaml").write_text(spoilt)
        (problem,) = check_file(tmp_path / "ECM-Si-demo.yaml").problems
        assert problem.key == "lookup" and "4096" in problem.allowed + problem.text, wrong


def _context() -> Context:
    return Context(search_path((PROJECT_CONFIGS,)))


def _chain(path: Path) -> document.Chain:
    found = load_chain(_context(), path)
    assert found is not None
    return found


def _tool(path: Path) -> document.Tool:
    found = load_tool(_context(), path, "")
    assert found is not None
    return dataclasses.replace(found, source="")


def _gains(path: Path) -> tuple[document.PidAxis, ...]:
    opened = _context().open(PidFile, path)
    assert opened is not None
    return opened.content.pid
