"""Commands of `import trocar` whose numbers are in another frame than the reference frame."""

from __future__ import annotations

import numpy as np
import pytest

import trocar
from tests.system.robot import ROOT, Robot, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
SECONDS = 120.0
BASE = np.eye(4)
BASE[:3, 3] = 0.05, 0.0, -0.03
STAY = np.eye(4)


def test_poses_of_local_stay_where_they_are_in_the_frame_of_the_base_and_unknown_frames_are_refused(
        robot: Robot) -> None:
    robot.up(ROOT / "configs/systems/kinematic.yaml")
    with trocar.psm("PSM1", robot.name) as psm:
        psm.home(SECONDS)
        psm.move_jp((0.1, 0.1, 0.12, 0.0, 0.0, 0.0)).wait(SECONDS)
        psm.set_base_frame(BASE, "room")
        wait_for(lambda: psm.reference_frame() == "room", SECONDS, "the reference frame")
        here, local, there = psm.setpoint_jp()[0], psm.local.setpoint_cp()[0], psm.setpoint_cp()[0]
        for pose, frame in ((local, "PSM1_base"), (there, "room"), (there, "")):
            psm.move_cp(pose, frame=frame).wait(SECONDS)
            assert np.allclose(psm.setpoint_jp()[0], here, atol=1e-5), frame
        psm.move_cr(STAY, "PSM1_base").wait(SECONDS)
        psm.servo_cp(local, frame="PSM1_base")
        psm.servo_cs(local, frame="PSM1_base")
        psm.servo_cr(STAY, "PSM1_base")
        assert np.allclose(psm.setpoint_jp()[0], here, atol=1e-5)
        impedance = trocar.Impedance(force_position=there[:3, 3])
        for command in (lambda frame: psm.move_cp(local, frame), lambda frame: psm.move_cr(STAY, frame),
                        lambda frame: psm.servo_cp(local, frame=frame), lambda frame: psm.servo_cr(STAY, frame),
                        lambda frame: psm.servo_cs(local, frame=frame),
                        lambda frame: psm.servo_cf(np.zeros(6), frame),
                        lambda frame: psm.body.servo_cf(np.zeros(6), frame),
                        lambda frame: psm.spatial.servo_cf(np.zeros(6), frame),
                        lambda frame: psm.servo_ci(impedance, frame)):
            with pytest.raises(trocar.Refused, match="frame nowhere"):
                command("nowhere")
