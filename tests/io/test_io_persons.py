"""io gives power to nobody whose command is older than the robot's last fault."""

from __future__ import annotations

import pytest

from tests.guarded import FakeCell
from tests.io.harness import FakeCommand, IoHarness
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import Code
from trocar.shm.mailbox.origins import Origin


def harness() -> tuple[IoHarness, FakeCell]:
    made, cell = IoHarness(), FakeCell()
    made.core.parts.faults[:] = [cell]
    return made, cell


def asked(made: IoHarness, name: str, generation: int, *values: float) -> str:
    command = FakeCommand(name, "PSM1", *values, origin=Origin(77, generation, "trocar home"))
    made.run(1, command)
    return command.outcome


def test_a_fault_with_power_on_voids_what_was_asked_for_before() -> None:
    made, cell = harness()
    assert asked(made, "power_on", 0) == "accepted"
    made.run(20)
    assert made.record.amps_on[0] and cell.valid_from == 0
    made.core.reports.trip(codes.POWER_LOST, 0)
    made.run()
    assert cell.valid_from == 1 and not made.record.power_requested[0]
    assert asked(made, "power_on", 0) == "refused" and asked(made, "bias_encoders", 0, 10.0) == "refused"
    assert asked(made, "power_off", 0) == "done" and asked(made, "pid_enable", 0, 0.0) == "done"
    assert asked(made, "power_on", 1) == "refused", "a stop by a void command makes it valid no more than it was"
    assert asked(made, "power_on", cell.valid_from) == "accepted"


@pytest.mark.parametrize("code", [codes.POWER_TIMEOUT, codes.AMPLIFIER])
def test_power_that_does_not_come_is_requested_again_only_by_a_later_command(code: Code) -> None:
    made, cell = harness()
    asked(made, "power_on", 0)
    made.core.reports.trip(code, 0)
    made.run()
    assert asked(made, "power_on", 0) == "refused" and not made.record.power_requested[0]
    assert asked(made, "power_on", cell.valid_from) == "accepted"
