"""The original's runs, step by step, on KINEMATIC arms of ours: what differs stands in a table, nothing else does.

dVRK 2.4.0 was driven by 185 steps; its end states were kept, and its events in order. Durations are not compared:
those of the original depend on how busy its machine was.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

from tests.whole import original_steps
from tests.whole.original_differences import DIFFERENCES
from tests.whole.original_robot import OriginalRobot

pytestmark = pytest.mark.slow

FILES: Final = {"PSM": "PSM_KIN_SIMULATED_LARGE_NEEDLE_DRIVER_400006", "ECM": "ECM_KIN_SIMULATED_STRAIGHT",
                "MTML": "MTML_KIN_SIMULATED", "MTMR": "MTMR_KIN_SIMULATED"}
ARMS: Final = {"psm": ("PSM1",), "mtm": ("MTMR",), "ecm": ("ECM",), "teleop": ("MTML", "MTMR", "PSM1", "PSM2", "ECM")}
PLAYED: Final[dict[str, Callable[[OriginalRobot], None]]] = {
    "psm": original_steps.psm, "mtm": original_steps.mtm, "ecm": original_steps.ecm, "teleop": original_steps.teleop}
PERIOD_S: Final = 0.005
"""Of teleoperations, as of the arms."""
SIDE_M: Final = {"MTML": 0.18, "MTMR": -0.18}


def row(run: str, name: str) -> dict[str, Any]:
    """An arm of the stock share; of a teleoperation's masters also their place at the console."""
    file = FILES.get(name) or FILES[name[:3]]
    found: dict[str, Any] = {"name": name, "type": name[:3], "simulation": "KINEMATIC", "arm_file": f"arm/{file}.json"}
    if run == "teleop" and name in SIDE_M:
        found["base_frame"] = {"reference_frame": "HRSV", "transform": [
            [-1.0, 0.0, 0.0, SIDE_M[name]], [0.0, 0.866025404, 0.5, 0.4], [0.0, 0.5, -0.866025404, 0.475],
            [0.0, 0.0, 0.0, 1.0]]}
    return found


def system(run: str) -> dict[str, Any]:
    """The system that the original had in this run."""
    found = {"$id": "dvrk-system.schema.json", "$version": "1", "arms": [row(run, name) for name in ARMS[run]]}
    if run == "teleop":
        pairs = [{"MTM": f"MTM{side}", "PSM": psm, "period": PERIOD_S,
                  "configure_parameter": {"start_gripper_threshold": 0.0}}
                 for side, psm in (("R", "PSM1"), ("L", "PSM2"))]
        found["consoles"] = [{"name": "console", "input_type": "SIMULATED", "teleop_PSMs": pairs,
                              "teleop_ECMs": [{"MTML": "MTML", "MTMR": "MTMR", "ECM": "ECM", "period": PERIOD_S}]}]
    return found


@pytest.mark.parametrize("run", PLAYED)
def test_what_differs_from_the_original_stands_in_the_table(run: str, data: Callable[[str], Path], tmp_path: Path
                                                            ) -> None:
    file = tmp_path / "system.json"
    file.write_text(json.dumps(system(run)))
    with OriginalRobot(data(f"golden/original-runs/{run}.json"), file, data("dvrk-share")) as robot:
        PLAYED[run](robot)
        assert robot.ended(), "the original has more steps"
    rows = [each for each in DIFFERENCES if run in each.runs.split()]
    used = {line: next((each for each in rows if each.fits(line)), None) for line in robot.differences}
    unknown = [line for line, row_of in used.items() if row_of is None]
    assert not unknown, "differences that are not in the table:\n" + "\n".join(unknown)
    gone = [each for each in rows if each not in used.values()]
    assert not gone, "rows of the table that no longer differ:\n" + "\n".join(map(str, gone))


def test_each_reason_has_its_mark() -> None:
    assert all(re.match(r"\[[KFQ]\] ", each.reason) for each in DIFFERENCES)
