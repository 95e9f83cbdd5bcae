"""What io checks of the boards that it found before anything is computed or written."""

from __future__ import annotations

import pytest

from tests.io.harness import FakePort, actuator, document, robot
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.robots import Robots
from trocar.procs.io.start import check


@pytest.mark.parametrize(("axis", "is_there"), [(3, True), (4, False), (7, False)])
def test_an_axis_that_the_board_found_does_not_have_is_refused_whatever_the_file_calls_it(
    axis: int, is_there: bool,
) -> None:
    actuators = tuple(actuator(0, i) for i in (0, 1, axis))
    robots = Robots(document(robots=(robot("PSM1", 0, hardware="HARDWARE_UNDEFINED", actuators=actuators),), pids=()))
    found = FakePort((0,)).discover()
    if is_there:
        check(robots, found)
        return
    with pytest.raises(PortError, match=f"board 0 is a QLA1, without axis {axis}; it has axes 0 to 3"):
        check(robots, found)
