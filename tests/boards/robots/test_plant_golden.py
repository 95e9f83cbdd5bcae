"""The plant against numbers of the original routines: every tip is where they say, and weighs what they hold."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import stock
from tests.boards.robots.arms import LND, LND_SI, SNAKE, arm, holding, psm, robot, run, si, system
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import Chain, DhLink, ModelVariation
from trocar.procs.kinematics.coupling import coupling

Data = Callable[[str], Path]

STRAIGHT = np.array(((0.0, 1.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
TOLERANCE_NM = 1e-6


def golden(data: Data, name: str) -> list[dict[str, Any]]:
    """The records of a golden file."""
    rows = [json.loads(line) for line in data(f"golden/kinematics/{name}.jsonl").read_text().splitlines()]
    return [row for row in rows if "meta" not in row]


def one_arm(kind: str, file: str, types: str) -> Plant:
    return Plant(system((robot(kind, types),), (arm(kind, kind, file),)))


@pytest.mark.parametrize("tool", [LND, SNAKE])
def test_instruments_reach_where_the_originals_say(data: Data, tool: str) -> None:
    plant = psm(tool)
    pair = coupling(7, stock.chain("PSM"), stock.tool(tool))
    records = golden(data, f"PSM_{tool}{'_snake' if tool == SNAKE else ''}")
    if tool == SNAKE:  # some are of no real snake: its bends come in equal pairs
        records = [row for row in records if row["q"][4:6] == row["q"][:5:-1]]
    assert len(records) >= 160
    for row in records:
        joints = np.append(row["q"][:6], 0.2)
        joints[4:6] *= 2.0 if tool == SNAKE else 1.0
        plant.place("PSM1", pair.joint_to_actuator @ joints)
        np.testing.assert_allclose(plant.tip("PSM1"), row["fk"], atol=1e-9)


def test_masters_and_cameras_reach_where_the_originals_say(data: Data) -> None:
    for kind, file, types, tip in (("MTM", "MTML", "RRRRRRR", np.eye(4)), ("ECM", "ECM_straight", "RRPR", STRAIGHT)):
        chain = file.split("_")[0]
        plant, pair = one_arm(kind, chain, types), coupling(len(types), stock.chain(chain))
        for row in golden(data, file):
            plant.place(kind, pair.joint_to_actuator @ np.array(row["q"]))
            np.testing.assert_allclose(plant.tip(kind) @ tip, row["fk"], atol=1e-9)


def set_up_chain(data: Data, file: str, name: str) -> Chain:
    """The chain of a setup arm."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", data(f"dvrk-share/{file}").read_text(), flags=re.DOTALL)
    rows = next(one for one in json.loads(text)["arms"] if one["name"] == name)["DH"]["links"]
    keys = ("alpha", "A", "theta", "D", "offset")
    links = tuple(DhLink(f"{i}", r["type"], *(r.get(k, 0.0) for k in keys), -3.1, 3.1, 0.0) for i, r in enumerate(rows))
    return Chain("modified", links, source=file)


def test_set_up_arms_reach_where_the_originals_say_and_stay(data: Data) -> None:
    plants: dict[tuple[str, str], Plant] = {}
    for row in golden(data, "suj_fk"):
        key = row["file"], row["arm"]
        if key not in plants:
            generation = "Si" if "si" in row["file"] else "Classic"
            chain = set_up_chain(data, *key)
            one = dataclasses.replace(arm("SUJ", f"SUJ_{generation}", "ECM"), generation=generation, chain=chain)
            plants[key] = Plant(system((robot("SUJ", "P" + "R" * (len(chain.links) - 1)),), (one,)))
        plant = plants[key]
        plant.place("SUJ", np.array(row["q"]))
        np.testing.assert_allclose(plant.tip("SUJ"), row["fk"], atol=1e-9)
    assert len(plants) == 8
    for plant in plants.values():
        start = plant.position.copy()
        run(plant, np.zeros(plant.axes), 100)
        np.testing.assert_array_equal(plant.position, start)
        plant.push("SUJ", np.full(plant.axes, 4.0))
        run(plant, np.zeros(plant.axes), 100)
        np.testing.assert_allclose(plant.position, start, atol=1e-4)


@pytest.mark.parametrize("tool", ["", LND_SI])
def test_an_si_psm_weighs_what_the_originals_hold(data: Data, tool: str) -> None:
    rows = golden(data, "gravity_PSM_Si")
    for pitch in sorted({row["pitch"] for row in rows}):
        plant = si("PSM", pitch, tool, like=ModelVariation("PSM", friction=0.0))
        for row in (row for row in rows if row["pitch"] == pitch):
            held = holding(plant, "PSM", np.array([*row["q"][:3], 0.0, 0.0, 0.0, 0.0]))
            np.testing.assert_allclose(held, [*row["effort"], 0.0], atol=TOLERANCE_NM)


def test_a_camera_weighs_what_the_originals_hold(data: Data) -> None:
    *before, insertion, roll = stock.chain("ECM").links
    chain = dataclasses.replace(stock.chain("ECM"), links=(*before, dataclasses.replace(insertion, mass=1.5), roll))
    rows = golden(data, "gravity_ECM_Classic_SD")
    for pitch in sorted({row["pitch"] for row in rows}):
        one = dataclasses.replace(arm("ECM", "ECM", "ECM"), chain=chain, mounting_pitch=pitch)
        plant = Plant(system((robot("ECM", "RRPR"),), (one,), 1, ModelVariation("ECM", friction=0.0)))
        for row in (row for row in rows if row["pitch"] == pitch):
            np.testing.assert_allclose(holding(plant, "ECM", np.array(row["q"])), row["effort"], atol=TOLERANCE_NM)


def test_an_si_camera_weighs_what_the_originals_hold() -> None:
    plant = si("ECM", endoscope=1.8, like=ModelVariation("ECM", friction=0.0))
    held = holding(plant, "ECM", np.array((0.2, -0.3, 0.15, 0.4)))
    np.testing.assert_allclose(held, (-2.7534, 10.11702, -16.53305, 0.0), atol=1e-5)  # given with five digits
