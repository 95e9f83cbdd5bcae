"""What the demo reports of a run."""

from __future__ import annotations

from contextlib import closing

from tests.tools.robot import ScriptedRobot
from tests.tools.test_verbs import kinematic as kinematic  # a fixture
from trocar.procs.tables import codes
from trocar.tools.inspect.health import HealthWatch


def test_an_error_that_others_repeat_is_one(kinematic: ScriptedRobot) -> None:
    with closing(HealthWatch(kinematic.name, "IO1")) as run:
        for text in ("axis 2 cannot follow", "PSM1: axis 2 cannot follow", "IO1: PSM1: axis 2 cannot follow", "silent"):
            kinematic.events.report(codes.TRACKING, text, "PSM1", 2, 0.06, 0.05, 6)
        run.collect()
        assert list(run.errors) == ["axis 2 cannot follow", "silent"]
