"""Wrenches of a running arm: NaN until somebody wants them, valid while, and NaN after that one was killed."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tests.system.robot import ROOT, Robot, time_passes, wait_for
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
READER = """
import contextlib, sys, trocar
psm = trocar.arm("PSM1", system=sys.argv[1])
wrench = None
while wrench is None:
    with contextlib.suppress(TimeoutError):  # a busy machine takes longer
        wrench, _ = psm.body.measured_cf()
print(wrench.size, flush=True)
sys.stdin.read()
"""


def test_wrenches_are_computed_while_a_program_wants_them(robot: Robot) -> None:
    robot.up(ROOT / "configs/systems/kinematic.yaml")
    robot.trocar("home")
    ring = directory.reader(robot.name, "PSM1", "state", "arm")
    shown = [ring.field(name) for name in ("body_measured_cf", "spatial_measured_cf")]

    def computed(wanted: bool) -> bool:
        assert ring.newest() and ring.field("cartesian_valid")[()]
        return all((np.isfinite if wanted else np.isnan)(field).all() for field in shown)

    assert computed(False)
    robot.trocar("echo", "PSM1/measured_js", "--once")
    assert computed(False)
    with subprocess.Popen([sys.executable, "-c", READER, robot.name], cwd=ROOT, stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, text=True) as reader:
        assert reader.stdout is not None
        try:
            with time_passes():
                assert reader.stdout.readline() == "6\n"
            for _ in range(20):
                last = ring.head
                wait_for(lambda: ring.head > last, 30, "the next record")  # noqa: B023  # it is called at once
                assert computed(True)
        finally:
            reader.kill()
    wait_for(lambda: computed(False), 30, "the supervisor to clear what the dead wanted")
    assert np.isnan(ring.field("spatial_jacobian")[:, :6]).all()
    ring.close()
    assert robot.down() == 0
