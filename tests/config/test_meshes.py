"""Meshes of a checkout of dvrk_model in the description of an arm: where its own joints would put them."""

from __future__ import annotations

import math
from pathlib import Path
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document import system as document
from trocar.procs.kinematics.inverse.arms import carrying
from trocar.procs.kinematics.urdf import urdf

XACRO = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="base" params="prefix parent_link xyz rpy">
  <link name="${prefix}RCM_link"/>
  <joint name="${prefix}rcm_fixed" type="fixed"><parent link="${parent_link}"/><child link="${prefix}RCM_link"/></joint>
  <joint name="${prefix}base_fixed" type="fixed"><parent link="${prefix}RCM_link"/><child link="${prefix}base_link"/>
    <origin rpy="${rpy}" xyz="${xyz}"/></joint>
  <link name="${prefix}base_link"><visual><geometry><mesh filename="package://dvrk_model/meshes/FILE"/></geometry></visual>
  </link>
  <joint name="yaw" type="revolute"><parent link="${prefix}base_link"/><child link="${prefix}yaw_link"/>
    <axis xyz="0 0 1"/><origin rpy="0.0 -1.5708 ${PI_2}" xyz="0 0 0"/></joint>
  <link name="${prefix}yaw_link"><visual><origin rpy="0.1 0.2 ${PI/4}" xyz="0.1 0.2 0.3"/>
    <geometry><mesh filename="package://dvrk_model/meshes/b.stl" scale="0.001 0.001 0.001"/></geometry></visual></link>
  <joint name="pitch" type="revolute"><parent link="${prefix}yaw_link"/><child link="${prefix}pitch_link"/>
    <axis xyz="0 0 1"/><origin rpy="-1.5708 -${PI_2} 0.0" xyz="0 0 0"/></joint>
  <link name="${prefix}pitch_link"/>
  <joint name="pitch_2" type="continuous"><parent link="${prefix}yaw_link"/><child link="${prefix}pitch_2_link"/>
    <axis xyz="0 0 1"/><origin rpy="-1.5708 -1.5708 0" xyz="0 0.03 0.5"/><mimic joint="pitch"/></joint>
  <link name="${prefix}pitch_2_link"/>
  <joint name="pitch_4" type="continuous"><parent link="${prefix}pitch_2_link"/><child link="${prefix}pitch_4_link"/>
    <axis xyz="0 0 1"/><origin xyz="0.04 0.15 0"/><mimic joint="pitch" multiplier="-1"/></joint>
  <link name="${prefix}pitch_4_link"><visual><geometry><mesh filename="package://dvrk_model/meshes/b.stl"/></geometry></visual>
  </link></xacro:macro></robot>"""
SHOWN = """<link name="{}"><visual><geometry><mesh filename="package://dvrk_model/meshes/b.stl"/></geometry></visual></link>"""
REMOTE = "<robot>" + "".join(map(SHOWN.format, ("base_link", "pitch_3_link", "insertion_link"))) + """
  <joint name="rcm"><parent link="world"/><child link="RCM_link"/><origin xyz="0.1 0.2 0.3"/></joint>
  <joint name="base"><parent link="RCM_link"/><child link="base_link"/><origin xyz="-0.6 0 0"/></joint>
  <joint name="yaw"><parent link="base_link"/><child link="yaw_link"/><axis xyz="1 0 0"/><origin xyz="0.1 0 0"/></joint>
  <joint name="pitch"><parent link="yaw_link"/><child link="pitch_link"/><axis xyz="0 1 0"/>
    <origin xyz="0.2 0 0"/></joint>
  <joint name="pitch_2"><parent link="pitch_link"/><child link="pitch_2_link"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.3"/>
    <mimic joint="pitch" multiplier="-1"/></joint>
  <joint name="pitch_3"><parent link="pitch_2_link"/><child link="pitch_3_link"/><axis xyz="0 1 0"/>
    <origin xyz="0.3 0 0"/>
    <mimic joint="pitch"/></joint>
  <joint name="insertion"><parent link="pitch_3_link"/><child link="insertion_link"/><axis xyz="0 0 -1"/>
    <origin xyz="0 0 0.2"/></joint></robot>"""
"""A parallelogram, whose pivot is 0.3 m from the remote centre; its yaw turns the other way than ours."""
STL = b"solid a\nendsolid a\n"
NEAR = 1e-4  # their angles have four digits


def model_checkout(folder: Path) -> Path:
    """One with two meshes, and a file that is none of them."""
    made = folder / "dvrk_model"
    (made / "urdf/Classic").mkdir(parents=True)
    (made / "meshes").mkdir()
    (made / "package.xml").write_text("<package/>")
    for name in ("meshes/a.stl", "meshes/b.stl", "outside.stl"):
        (made / name).write_bytes(STL)
    return made


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    return model_checkout(tmp_path)


def loaded(checkout: Path, file: str = "a.stl", xacro: str = XACRO) -> document.SystemConfig:
    (checkout / "urdf/Classic/PSM_base.urdf.xacro").write_text(xacro.replace("FILE", file))
    found = load_system(PROJECT_CONFIGS / "systems/kinematic.yaml", search=[checkout.parent])
    assert found.system is not None, found.errors
    return found.system


def description(system: document.SystemConfig) -> ElementTree.Element:
    arm = system.arms[0]
    return ElementTree.fromstring(urdf(arm.name, carrying(arm, ""), arm.meshes))


def turn(x: float, y: float, z: float) -> NDArray[np.float64]:
    (a, b, c), (d, e, f) = map(math.sin, (x, y, z)), map(math.cos, (x, y, z))
    return np.array([[f, -c, 0], [c, f, 0], [0, 0, 1]]) @ [[e, 0, b], [0, 1, 0], [-b, 0, e]] @ np.array(
        [[1, 0, 0], [0, d, -a], [0, a, d]])


def pose(origin: ElementTree.Element) -> NDArray[np.float64]:
    made = np.eye(4)
    made[:3, 3] = [float(word) for word in origin.get("xyz", "").split()]
    made[:3, :3] = turn(*(float(word) for word in origin.get("rpy", "").split()))
    return made


def link_at(robot: ElementTree.Element, link: str, **q: float) -> NDArray[np.float64]:
    """Where a link is, as robot_state_publisher has it."""
    made = np.eye(4)
    while joint := next((each for each in robot.iter("joint") if each.find("child").get("link") == link), None):
        mimic, value = joint.find("mimic"), q.get(joint.get("name", ""), 0.0)
        if mimic is not None:
            value = q.get(mimic.get("joint", ""), 0.0) * float(mimic.get("multiplier", "1"))
        moved = np.eye(4)
        moved[:3, :3] = turn(0.0, 0.0, value)
        made, link = pose(joint.find("origin")) @ moved @ made, joint.find("parent").get("link", "")
    return made


def test_meshes_are_where_the_joints_of_the_model_put_them(checkout: Path) -> None:
    robot = description(loaded(checkout))
    files = {mesh.get("filename", "") for mesh in robot.iter("mesh")}
    assert {unquote(urlparse(file).path) for file in files} == {
        str(checkout.resolve() / "meshes" / name) for name in ("a.stl", "b.stl")}
    yaw = np.eye(4)
    yaw[:3, :3] = turn(0.0, -math.pi / 2, math.pi / 2) @ turn(0.0, 0.0, 0.3)
    assert np.allclose(link_at(robot, "PSM1_yaw_link", yaw=0.3), yaw, atol=NEAR)
    second = np.eye(4)
    second[:3, :3], second[:3, 3] = turn(-math.pi / 2, -math.pi / 2, 0.0) @ turn(0.0, 0.0, 0.2), (0.0, 0.03, 0.5)
    fourth = np.eye(4)
    fourth[:3, :3], fourth[:3, 3] = turn(0.0, 0.0, -0.2), (0.04, 0.15, 0.0)
    assert np.allclose(link_at(robot, "PSM1_pitch_4_link", yaw=0.3, pitch=0.2), yaw @ second @ fourth, atol=NEAR)
    visual = next(link for link in robot.iter("link") if link.get("name") == "PSM1_yaw_link").find("visual")
    assert visual is not None and visual.find("geometry/mesh").get("scale") == "0.001 0.001 0.001"
    assert np.allclose(pose(visual.find("origin"))[:3, 3], (0.1, 0.2, 0.3), atol=NEAR)


def test_a_root_and_axes_that_are_turned_make_no_difference(checkout: Path) -> None:
    plain = description(loaded(checkout))
    turned = XACRO.replace('<origin rpy="0.0 -1.5708 ${PI_2}" xyz="0 0 0"/></joint>',
                           '<origin rpy="0.0 -1.5708 ${PI_2*2}" xyz="0 0 0"/></joint>')
    robot = description(loaded(checkout, xacro=turned))
    for link in ("yaw_link", "pitch_4_link"):
        assert np.allclose(link_at(robot, f"PSM1_{link}", yaw=0.3, pitch=0.2),
                           link_at(plain, f"PSM1_{link}", yaw=0.3, pitch=0.2), atol=NEAR)


def test_a_parallelogram_keeps_its_remote_centre_and_its_yaw_may_turn_the_other_way(checkout: Path) -> None:
    robot = description(loaded(checkout, xacro=REMOTE))
    assert np.allclose(link_at(robot, "PSM1_base_link")[:3, 3], (0.0, -0.6, 0.0), atol=NEAR)
    assert np.allclose(link_at(robot, "PSM1_insertion_link")[:3, 3], (0.0, 0.0, 0.5), atol=NEAR)
    relative = [np.linalg.inv(link_at(robot, "PSM1_pitch_3_link", **q)) @ link_at(robot, "PSM1_insertion_link", **q)
                for q in ({}, {"yaw": 0.3, "pitch": 0.2})]
    assert np.allclose(*relative, atol=NEAR), "one follows the parallelogram, the other our chain"


def test_files_that_git_lfs_has_not_fetched_are_left_out_and_named(checkout: Path) -> None:
    (checkout / "meshes/b.stl").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    system = loaded(checkout)
    assert len([*description(system).iter("mesh")]) == 1
    assert any("1 meshes of" in note and "git lfs pull" in note for note in system.notes)


@pytest.mark.parametrize("name", ["../outside.stl", "../../../etc/passwd"])
def test_a_mesh_outside_of_the_folder_of_meshes_is_not_shown(checkout: Path, name: str) -> None:
    system = loaded(checkout, file=name)
    assert not [*description(system).iter("mesh")]
    assert any("outside of its folder" in note for note in system.notes)


def test_a_link_to_a_file_outside_is_not_shown(checkout: Path) -> None:
    (checkout / "meshes/a.stl").unlink()
    (checkout / "meshes/a.stl").symlink_to(checkout / "outside.stl")
    assert not [*description(loaded(checkout)).iter("mesh")]


@pytest.mark.parametrize("xacro", ["<robot", "<robot/>", XACRO.replace("1.5708", "${import os}"),
                                   XACRO.replace('"0 0 1"', '"0 0 0"'), XACRO.replace("${PI_2}", "${PI_9}")])
def test_a_file_that_cannot_be_read_leaves_the_arm_as_it_is_without(checkout: Path, xacro: str) -> None:
    system = loaded(checkout, xacro=xacro)
    assert not system.arms[0].meshes and system.arms[0].name == "PSM1"
