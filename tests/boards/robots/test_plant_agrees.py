"""The kinematics by which arms compute, and MuJoCo, in which emulated ones move, put every tip at the same place."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests import stock
from tests.boards.robots.arms import arm, psm, robot, si, system
from tests.cases import cases
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.kinematics.endoscopes import NAMES, endoscope
from trocar.procs.kinematics.forward import Kinematics

AGREED = 1e-9  # m, and of rotation matrices
DRAWS = 12
TOOLS = tuple(sorted(path.stem for path in stock.find("dvrk-share/tool").glob("*_4*.json")))


def drawn(chain: Kinematics, name: str) -> np.ndarray:
    """Joint vectors (DRAWS, n) within the limits, the same in every run."""
    generator = np.random.default_rng(list(name.encode()))
    return generator.uniform(chain.lower, chain.upper, (DRAWS, chain.n))


@cases("tool", TOOLS)
@cases("generation", ["Classic", "Si"])
def test_both_models_of_a_psm_agree_with_every_instrument(generation: str, tool: str) -> None:
    instrument = stock.tool(tool)
    plant, name, file = psm(tool), "PSM1", "PSM"
    if generation == "Si":
        plant, name, file = si("PSM", tool=tool), "PSM", "PSM_Si"
    chain, pair = Kinematics(stock.chain(file), instrument), coupling(7, stock.chain(file), instrument)
    for q in drawn(chain, tool + generation):
        joints = np.append(q[:6], 0.3)
        if instrument.snake:  # its bends come in equal pairs, of which a joint is the sum
            q[7], q[6] = q[4], q[5]
            joints[4:6] = 2.0 * q[4:6]
        plant.place(name, pair.joint_to_actuator @ joints)
        np.testing.assert_allclose(plant.tip(name), chain.fk(q), atol=AGREED, rtol=0)


@pytest.mark.parametrize("generation", ["Classic", "Si"])
def test_both_models_of_an_ecm_agree_with_every_endoscope(generation: str) -> None:
    file = "ECM" if generation == "Classic" else "ECM_Si"
    one = arm("ECM", "ECM", file)
    plant = Plant(system((robot("ECM", "RRPR"),), (one,))) if generation == "Classic" else si("ECM", endoscope=1.8)
    for name in NAMES:
        chain = Kinematics(stock.chain(file), tip=endoscope(name).tip)
        for q in drawn(chain, name):
            plant.place("ECM", q)
            np.testing.assert_allclose(plant.tip("ECM") @ endoscope(name).tip, chain.fk(q), atol=AGREED, rtol=0)


@pytest.mark.parametrize("side", ["MTML", "MTMR"])
def test_both_models_of_a_master_agree(side: str) -> None:
    plant = Plant(system((robot(side, "RRRRRRR"),), (arm(side, "MTM", side),)))
    chain, pair = Kinematics(stock.chain(side)), coupling(7, stock.chain(side))
    for q in drawn(chain, side):
        plant.place(side, pair.joint_to_actuator @ q)
        np.testing.assert_allclose(plant.tip(side), chain.fk(q), atol=AGREED, rtol=0)


def test_a_base_offset_is_in_both_models() -> None:
    base = ((0.0, -1.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.2), (0.0, 0.0, 1.0, 0.3), (0.0, 0.0, 0.0, 1.0))
    moved = dataclasses.replace(stock.chain("ECM"), base=base)
    plant = Plant(system((robot("ECM", "RRPR"),), (dataclasses.replace(arm("ECM", "ECM", "ECM"), chain=moved),)))
    chain = Kinematics(moved)
    for q in drawn(chain, "base"):
        plant.place("ECM", q)
        np.testing.assert_allclose(plant.tip("ECM"), chain.fk(q), atol=AGREED, rtol=0)
