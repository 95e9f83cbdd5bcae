"""Meshes of a checkout of dvrk_model in a real browser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.config.test_meshes import XACRO, description, link_at, loaded, model_checkout, pose
from tests.gui.chromium import chromium
from tests.gui.test_chromium import served
from tests.system.conftest import records as records
from tests.system.conftest import robot as robot
from tests.system.conftest import robots as robots
from tests.system.robot import ROOT, Robot

pytestmark = [pytest.mark.slow, pytest.mark.peers, pytest.mark.simulated("paced")]
BROKEN = XACRO[::-1].replace("lts.b", "ead.c", 1)[::-1]
"""The last link has another mesh."""
STL = """solid b
facet normal 0 0 1 outer loop vertex 100 0 0 vertex 0 200 0 vertex 0 0 300 endloop endfacet
endsolid b
"""
COLLADA = """<!DOCTYPE COLLADA [<!ENTITY other SYSTEM "file:///etc/hostname">]>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array count="12" id="a">1 0 0 2 0 0 2 1 0 1 1 0</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1"><input offset="1" semantic="VERTEX" source="#v"/><input offset="0" semantic="NORMAL" source="#n"/>
<vcount>4</vcount><p>0 0 0 1 0 2 0 3</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>&other;0 0 5</translate><node><rotate>0 0 1 90</rotate>
<instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes></COLLADA>"""
CORNERS = """const model = document.querySelector('.stage').stage.models.PSM1;
model.group.updateWorldMatrix(true, true);
const base = model.parts.frames[0].matrixWorld.clone().invert();
return model.parts.parts.map((part) => part.children.filter((child) => child.isMesh).map((mesh) => {
  const corners = mesh.geometry.attributes.position.clone().applyMatrix4(base.clone().multiply(mesh.matrixWorld));
  return Array.from(corners.array);
}))"""


def test_meshes_move_with_the_joints_and_a_broken_one_is_reported(robot: Robot, tmp_path: Path) -> None:
    checkout = model_checkout(tmp_path)
    (checkout / "meshes/a.dae").write_text(COLLADA)
    (checkout / "meshes/b.stl").write_text(STL)
    (checkout / "meshes/c.dae").write_text(COLLADA[:-40])
    system = loaded(checkout, "a.dae", BROKEN)
    names, urdf = [row.name for row in system.arms[0].meshes], description(system)
    kinematic = ROOT / "configs" / "systems" / "kinematic.yaml"
    with served(robot, kinematic, "--path", str(tmp_path)) as address, chromium(address) as page:
        for word in ("enable", "home"):
            robot.trocar("send", "PSM1", "state_command", word, "--wait")
        robot.trocar("send", "PSM1", "move_jp", "0.3", "-0.2", "0.14", "0.5", "0.4", "-0.3", "--wait")
        for path in ("/arm/PSM1", "/3d"):
            page.open(path)
            page.until("document.querySelector('.stage')?.stage?.isDressed")
            assert "1 of 3 meshes are not shown: c.dae" in page.note()
            page.until("Math.abs(Math.max(...trocar.data('scene').arms.PSM1.turns) - 0.2) < 1e-3"
                       " && document.querySelector('.stage').stage.models.PSM1.parts.frames[1].quaternion.w < 1")
            corners = dict(zip(names, page.js(CORNERS), strict=True))
            visual = next(link for link in urdf.iter("link") if link.get("name") == "PSM1_yaw_link").find("visual")
            assert visual is not None
            yaw = link_at(urdf, "PSM1_yaw_link", yaw=0.3, pitch=-0.2) @ pose(visual.find("origin"))
            wanted = [(yaw @ (*corner, 1.0))[:3] for corner in np.diag((0.1, 0.2, 0.3))]
            assert np.allclose(np.reshape(corners["yaw_link"][0], (3, 3)), wanted, atol=1e-3)
            base = link_at(urdf, "PSM1_base_link")
            quad = [(0.0, 0.01), (0.0, 0.02), (-0.01, 0.02), (-0.01, 0.01)]
            wanted = [(base @ (*quad[k], 0.05, 1.0))[:3] for k in (0, 1, 2, 0, 2, 3)]
            assert np.allclose(np.reshape(corners["base_link"][0], (6, 3)), wanted, atol=1e-3)
            assert not corners["pitch_4_link"], "broken"
            assert page.js("return document.querySelector('.stage').stage.models.PSM1.links.some((rod) => rod.visible)")
        page.js("fetch('/files/mesh/..%2Fpackage.xml').then((answer) => { window.found = answer.status })")
        page.until("window.found === 404")
