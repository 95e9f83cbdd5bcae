"""What the document says about an arm beyond its joints: what it carries, what it weighs, what belongs to it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests import stock
from trocar.procs.config import load_system
from trocar.procs.document import system as document
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import pose_from_matrix

SHARE = "dvrk-share"


def site_arm(system: str, arm: str) -> document.ArmConfig:
    """An arm of a site's system, as its body is."""
    path = stock.find(f"dvrk-site/{system}.json")
    loaded = load_system(path, search=[stock.find(SHARE)], boards="emulated").system
    assert loaded is not None
    assert document.from_json(document.to_json(loaded)) == loaded
    return loaded.emulated().arm(arm)


def simulated_arm(folder: Path, family: str, **keys: object) -> document.ArmConfig:
    """A KINEMATIC arm from an arm file with these keys, as the emulation or the arm process would have it."""
    arm_file = {"$id": f"dvrk-{family.lower()}.schema.json", "$version": "1", **keys}
    (folder / "arm.json").write_text(json.dumps(arm_file))
    arms = [{"name": "A", "type": family, "simulation": "KINEMATIC", "arm_file": "arm.json"}]
    (folder / "system.json").write_text(
        json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "arms": arms}))
    loaded = load_system(folder / "system.json", search=[stock.find(SHARE)])
    assert loaded.system is not None, [str(problem) for problem in loaded.errors]
    return loaded.system.arm("A")


def test_inputs_of_an_arm_are_found_by_their_names() -> None:
    assert site_arm("jhu-dVRK/system-PSM1", "PSM1").inputs == document.ArmInputs(
        "PSM1_arm_clutch", "PSM1_adapter", "PSM1_tool", "PSM1_SUJ_clutch", "")
    assert site_arm("jhu-daVinci-Si/system-PSM1", "PSM1").inputs.suj_clutch_2 == "PSM1_SUJ_clutch_2"
    assert site_arm("jhu-daVinci/system-ECM", "ECM").inputs == document.ArmInputs(
        "ECM_arm_clutch", suj_clutch="ECM_SUJ_clutch")
    assert site_arm("jhu-dVRK/system-MTML", "MTML").inputs == document.ArmInputs()


def test_reader_of_instruments_is_the_one_of_the_arm() -> None:
    assert site_arm("jhu-dVRK/system-PSM1", "PSM1").instrument_reader == "PSM1_dallas"
    assert site_arm("jhu-daVinci/system-ECM", "ECM").instrument_reader == ""


def test_master_has_its_gripper_and_what_was_measured_on_it() -> None:
    arm = site_arm("jhu-dVRK/system-MTML", "MTML")
    assert (arm.gripper, arm.gripper_debounce_s, arm.gripper_zero, arm.platform_gain) == ("MTML_gripper", 0.2, 0.0, 0.5)
    assert arm.master_gravity is not None and len(arm.master_gravity.positive) == 40
    assert arm.homing_zero_position and arm.links is None


@pytest.mark.parametrize(("system", "arm", "links", "endoscope"), [
    ("jhu-dVRK/system-PSM1", "PSM1", 0, ""), ("jhu-daVinci-Si/system-PSM1", "PSM1", 7, ""),
    ("jhu-daVinci/system-ECM", "ECM", 4, "Classic_HD_STRAIGHT"),
    ("jhu-daVinci-Si/system-ECM", "ECM", 6, "Si_HD_STRAIGHT")])
def test_arms_that_have_weight_bring_the_stock_links(system: str, arm: str, links: int, endoscope: str) -> None:
    found = site_arm(system, arm)
    assert (len(found.links.links) if found.links else 0, found.endoscope) == (links, endoscope)
    assert not found.homing_zero_position


def test_an_arm_that_skips_gravity_compensation_has_none(tmp_path: Path) -> None:
    site = stock.find("dvrk-site/jhu-daVinci-Si")
    arm = {"name": "PSM1", "type": "PSM", "serial": "292409", "IO": "IO1", "arm_file": "arm.json"}
    keys = {"$id": "dvrk-system.schema.json", "$version": "1", "IOs": [{"name": "IO1", "port": "fw"}], "arms": [arm]}
    arm_file = {"$id": "dvrk-psm.schema.json", "$version": "1", "kinematic": "kinematic/PSM_Si.json",
                "generation": "Si", "mounting_pitch": 0.0, "skip_gravity_compensation": True}
    (tmp_path / "arm.json").write_text(json.dumps(arm_file))
    (tmp_path / "system.json").write_text(json.dumps(keys))
    loaded = load_system(tmp_path / "system.json", search=[stock.find(SHARE), site], boards="emulated").system
    assert loaded is not None and loaded.emulation is not None
    assert loaded.emulated().arm("PSM1").links is not None, "its body weighs all the same"
    assert all(arm.links is None for arm in loaded.arms)


def test_depth_of_the_cannula_and_gains_are_those_of_the_file(tmp_path: Path) -> None:
    kinematic = "kinematic/PSM.json"
    arm = simulated_arm(tmp_path, "PSM", kinematic=kinematic, generation="Classic", tool_detection="MANUAL",
                        cannula_depth=0.03)
    assert arm.cannula_depth == 0.03
    assert simulated_arm(tmp_path, "PSM", kinematic=kinematic, generation="Classic").cannula_depth == 0.0


def test_links_of_another_arm_are_refused(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"kinematic_gc.*chain of 3 rows.*7 rows"):
        simulated_arm(tmp_path, "PSM", kinematic="kinematic/PSM.json", generation="Classic",
                      kinematic_gc="kinematic/PSM.json")


def test_masters_are_where_the_file_of_the_full_system_puts_them() -> None:
    path = stock.find("dvrk-share/system/system-full-system-simulated.json")
    system = load_system(path, search=[stock.find(SHARE)]).system
    assert system is not None
    for name, x in (("MTML", 0.18), ("MTMR", -0.18)):
        arm = system.arm(name)
        pose = pose_from_matrix(np.array(arm.base_frame) @ Kinematics(arm.chain).fk(np.zeros(7)))
        np.testing.assert_allclose(pose[:3], (x, 0.019935, 0.404295), atol=2e-6)
        np.testing.assert_allclose(np.sign(pose[6]) * pose[3:], (-0.353555, 0.353552, 0.612375, 0.612370), atol=5e-6)
        assert arm.reference_frame == "HRSV"
