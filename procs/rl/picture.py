"""Pictures of a scene without a screen: by EGL, or in software by OSMesa, whichever this machine has."""

from __future__ import annotations

import ctypes
import importlib
import os
from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from trocar.procs.machine.extras import missing
from trocar.procs.rl.scene import BALL, BOX, ROD, TUBE, Drawn

GEOMS: Final = {BALL: mujoco.mjtGeom.mjGEOM_ELLIPSOID, ROD: mujoco.mjtGeom.mjGEOM_CAPSULE,
                TUBE: mujoco.mjtGeom.mjGEOM_CYLINDER, BOX: mujoco.mjtGeom.mjGEOM_BOX}
WAYS: Final = {"egl": "libEGL.so.1", "osmesa": "libOSMesa.so.8"}
"""And the library that each needs."""
MOST: Final = 500
"""Things in a scene."""
ROOM: Final = """<mujoco><visual>
 <headlight ambient="0.32 0.32 0.34" diffuse="0.40 0.40 0.40" specular="0.15 0.15 0.15"/>
 <global offwidth="{width}" offheight="{height}" fovy="32"/><map znear="0.02" zfar="12" shadowclip="1"/>
 <quality shadowsize="2048" offsamples="4"/></visual><statistic extent="0.5"/>
 <asset><texture name="sky" type="skybox" builtin="gradient" rgb1="0.93 0.95 0.97" rgb2="0.72 0.78 0.85" width="64"
 height="384"/><texture name="tiles" type="2d" builtin="checker" rgb1="0.84 0.86 0.88" rgb2="0.77 0.80 0.83" width="256"
 height="256"/><material name="floor" texture="tiles" texrepeat="24 24" texuniform="true"/></asset>
 <worldbody><light pos="0.3 -0.5 1.0" dir="-0.25 0.4 -0.9" directional="true" diffuse="0.55 0.55 0.52"
 specular="0.3 0.3 0.3" castshadow="true"/><body name="floor" mocap="true"><geom type="plane" size="1.5 1.5 0.1"
 material="floor"/></body></worldbody></mujoco>"""
AZIMUTH, ELEVATION = 125.0, -24.0
"""Direction of the camera, degrees."""


class PictureError(RuntimeError):
    """No picture can be drawn here; names the package to install."""


def _context(width: int, height: int) -> Any:
    """A drawing context; MUJOCO_GL may choose the method, else the first with an installed library.

    A process can have one method only: PyOpenGL keeps the first one for which it was loaded.
    """
    if lacks := missing("OpenGL"):
        raise PictureError(lacks)
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    ways = [way for way in ((wanted,) if wanted in WAYS else WAYS) if _is_there(WAYS[way])]
    why = f"{' and '.join(WAYS.values())} are not there"
    for way in ways[:1]:
        try:
            context = importlib.import_module(f"mujoco.{way}").GLContext(width, height)
            context.make_current()
            return context
        except Exception as error:  # PyOpenGL and drivers have many; to load their names would choose a way
            why = f"{way}: {error or type(error).__name__}"
    if len(ways) > 1:
        raise PictureError(f"nothing to draw with ({why}); {WAYS[ways[1]]} is there: start again with "
                           f"MUJOCO_GL={ways[1]} in the environment")
    raise PictureError(f"nothing to draw with ({why}); Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri, or "
                       "apt-get install libosmesa6 and MUJOCO_GL=osmesa")


def _is_there(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


class Picture:
    """Draws scenes of one size; close it."""

    def __init__(self, width: int, height: int) -> None:
        """PictureError if this machine cannot draw."""
        self._gl, self._pid = _context(width, height), os.getpid()
        self._model = mujoco.MjModel.from_xml_string(ROOM.format(width=width, height=height))
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, maxgeom=MOST)
        self._camera, self._option = mujoco.MjvCamera(), mujoco.MjvOption()
        self._place = mujoco.MjrRect(0, 0, width, height)
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._pixels = np.empty((height, width, 3), dtype=np.uint8)

    def draw(self, things: Sequence[Drawn], middle: NDArray[np.float64], floor_m: float,
             distance_m: float) -> NDArray[np.uint8]:
        """The picture (height, width, 3), a new array, with `middle` (3,) in its middle, from a distance.

        `floor_m` is the height of the floor.
        """
        self._gl.make_current()
        self._data.mocap_pos[0] = middle[0], middle[1], floor_m
        mujoco.mj_forward(self._model, self._data)
        camera = self._camera
        camera.lookat[:] = middle
        camera.distance, camera.azimuth, camera.elevation = distance_m, AZIMUTH, ELEVATION
        scene = self._scene
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, camera,
                               mujoco.mjtCatBit.mjCAT_ALL.value, scene)
        for thing in things[: MOST - scene.ngeom]:
            mujoco.mjv_initGeom(scene.geoms[scene.ngeom], GEOMS[thing.kind], np.array(thing.size), thing.middle,
                                thing.axes.reshape(-1), np.array(thing.colour, dtype=np.float32))
            scene.ngeom += 1
        mujoco.mjr_render(self._place, scene, self._context)
        mujoco.mjr_readPixels(self._pixels, None, self._place, self._context)
        return np.ascontiguousarray(self._pixels[::-1])

    def close(self) -> None:
        """Release the context; in a forked child that is the parent's."""
        if os.getpid() != self._pid:
            return
        self._gl.make_current()
        self._context.free()
        self._gl.free()
