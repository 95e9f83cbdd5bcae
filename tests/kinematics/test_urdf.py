"""Arms as URDF: pinocchio, which reads it, has the tip where we have it."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest

from tests.system.robot import ROOT
from trocar.procs.config import load_system
from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.endoscopes import NONE, endoscope
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.urdf import urdf


def arms() -> dict[str, ArmConfig]:
    found = {}
    for file in ("kinematic-full", "kinematic-psm-si", "kinematic-ecm-si"):
        system = load_system(ROOT / "configs" / "systems" / f"{file}.yaml").system
        assert system is not None
        found.update({f"{file} {row.name}": row for row in system.arms if row.name in ("PSM1", "ECM", "MTML")})
    return found


ARMS = arms()


@pytest.mark.parametrize("which", ARMS)
def test_the_tip_is_where_it_is_for_us(which: str) -> None:
    arm = ARMS[which]
    tip = endoscope(arm.endoscope or NONE).tip if arm.type == "ECM" else None
    kinematics = Kinematics(arm.chain, arm.tool, tip)
    model = pinocchio.buildModelFromXML(urdf(arm.name, kinematics))
    data = model.createData()
    assert tuple(model.names)[1:] == kinematics.names
    random = np.random.default_rng(1)
    for _ in range(20):
        q = random.uniform(kinematics.lower, np.minimum(kinematics.upper, kinematics.lower + 3.0))
        pinocchio.framesForwardKinematics(model, data, q)
        found = data.oMf[model.getFrameId(f"{arm.name}_tip")].homogeneous
        assert np.allclose(found, kinematics.fk(q, np.eye(4)), atol=1e-9)
    assert np.allclose(model.lowerPositionLimit, kinematics.lower)
    assert np.allclose(model.upperPositionLimit, kinematics.upper)


def test_something_can_be_seen_of_each_arm() -> None:
    arm = ARMS["kinematic-full PSM1"]
    robot = ElementTree.fromstring(urdf("PSM1", Kinematics(arm.chain, arm.tool)))
    lengths = [float(each.attrib["length"]) for each in robot.iter("cylinder")]
    assert len(lengths) > 2 and all(0.0 < length < 1.5 for length in lengths)
