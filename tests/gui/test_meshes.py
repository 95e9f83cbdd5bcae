"""Meshes on the pages: where parts are, and which files browsers get."""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import os
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.responses import Response

from tests.config.test_meshes import STL, XACRO, description, link_at, loaded, model_checkout
from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.document.arms import MeshLink
from trocar.procs.document.system import SystemConfig, from_json
from trocar.procs.gui.meshes import MeshFiles, drawn_parts, mesh_files
from trocar.procs.gui.scene_source import SceneArm, frames_of
from trocar.procs.kinematics.inverse.arms import carrying
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.procs.machine import mesh_file
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns

NEAR = 1e-4  # poses go out with five digits


@pytest.fixture
def system(tmp_path: Path) -> SystemConfig:
    return loaded(model_checkout(tmp_path))


def answers(system: SystemConfig, *numbers: str) -> list[Response]:
    files = MeshFiles(system, logging.getLogger("gui"))

    async def all_of_them() -> list[Response]:
        return [await files.file(number) for number in numbers]

    return asyncio.run(all_of_them())


def test_parts_of_an_arm_are_where_its_description_has_them(system: SystemConfig) -> None:
    arm, q = system.arms[0], {"yaw": 0.3, "pitch": 0.2, "insertion": 0.1}
    kinematics, base = carrying(arm, ""), matrix_from_pose(np.array((0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8)))
    sent = frames_of(kinematics, np.array([q.get(name, 0.0) for name in kinematics.names]), base)
    frames = [matrix_from_pose(pose) for pose in np.reshape(sent, (-1, 7))[:1 + len(arm.chain.links)]]
    parts = drawn_parts(arm, mesh_files(system))
    for part, row in zip(parts, arm.meshes, strict=True):
        angle = row.turn(q)
        about_z = matrix_from_pose(np.array((0.0, 0.0, 0.0, 0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))))
        frames.append(frames[part["parent"]] @ matrix_from_pose(np.array(part["pose"])) @ about_z)
        there = base @ link_at(description(system), f"PSM1_{row.name}", **q)
        assert np.allclose(frames[-1], there, atol=NEAR), row.name
    assert {row.name for row in arm.meshes} >= {"base_link", "yaw_link", "pitch_2_link", "pitch_4_link"}
    worn = {row.name: part["meshes"] for row, part in zip(arm.meshes, parts, strict=True)}
    assert worn["yaw_link"][0]["scale"] == [0.001] * 3 and not worn["pitch_2_link"]
    assert mesh_files(system)[worn["yaw_link"][0]["file"]].endswith("/meshes/b.stl")


def test_the_scene_contains_the_angles_of_parts_that_follow_a_joint(world: World) -> None:
    with robot(world.name) as scripted:
        document = from_json(directory.document(world.name))
        eye = tuple(map(tuple, np.eye(4).tolist()))
        parts = (MeshLink("one", "", eye), MeshLink("two", "one", eye, "yaw", -2.0))
        with closing(SceneArm(document, dataclasses.replace(document.arms[0], meshes=parts))) as arm:
            scripted.show_arm(0.1)
            assert arm.read(monotonic_ns())["turns"] == [0.0, -0.2]
    assert parts[1].turn({"yaw": float("nan")}) == 0.0, "not known"


def test_files_of_the_document_are_served_by_number_and_no_others(system: SystemConfig) -> None:
    first, *others = answers(system, "0", "2", "-1", "00", "", "a.stl", "..", "../package.xml", "9" * 9999)
    assert (first.status_code, first.body, first.media_type) == (200, STL, "model/stl")
    assert "max-age" in first.headers["cache-control"]
    assert {answer.status_code for answer in others} == {404}


def spoiled(file: Path, how: str) -> None:
    file.unlink()
    if how == "another's":
        file.symlink_to(file.parent.parent / "outside.stl")
    elif how == "a pipe":
        os.mkfifo(file)
    elif how == "too large":
        with file.open("wb") as stream:
            stream.truncate(mesh_file.MAX_BYTES + 1)


@pytest.mark.parametrize("how", ["removed", "another's", "a pipe", "too large"])
def test_a_file_that_cannot_be_served_is_logged_once(system: SystemConfig, caplog: pytest.LogCaptureFixture,
                                                     how: str) -> None:
    spoiled(Path(mesh_files(system)[0]), how)
    broken, again, other = answers(system, "0", "0", "1")
    assert broken.status_code == again.status_code == 404 and other.status_code == 200
    assert len([record for record in caplog.records if "a.stl" in record.message]) == 1


def test_a_format_that_pages_do_not_draw_leaves_the_part_without_a_mesh(tmp_path: Path) -> None:
    made = model_checkout(tmp_path)
    (made / "meshes/a.obj").write_text("v 0 0 0\n")
    system = loaded(made, file="a.obj", xacro=XACRO)
    assert [Path(file).name for file in mesh_files(system)] == ["b.stl"]
    worn: list[Any] = [part["meshes"] for part in drawn_parts(system.arms[0], mesh_files(system))]
    assert len(list(filter(None, worn))) == 2
