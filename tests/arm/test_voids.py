"""What makes older commands to an arm void: faults, power-offs, another io; and whose commands it passes on to io."""

from __future__ import annotations

import pytest

from tests.arm.fake_io import ArmHarness
from trocar.shm.mailbox.generations import NoFaults
from trocar.shm.mailbox.origins import Origin


class VoidCell(NoFaults):
    """Remembers what happened."""

    def __init__(self) -> None:
        self.reported: list[str] = []

    def fault(self) -> None:
        self.reported.append("fault")

    def void_earlier(self, origin: Origin) -> None:
        self.reported.append(f"off by {origin.id}")




class VoidedHarness(ArmHarness):
    """An arm whose faults are counted."""

    def __init__(self) -> None:
        super().__init__()
        self.cell = VoidCell()
        self.start_arm()

    def start_arm(self) -> None:
        super().start_arm()
        object.__setattr__(self.arm._around, "faults", getattr(self, "cell", NoFaults()))


def test_a_fault_voids_what_was_asked_for_before() -> None:
    harness = VoidedHarness()
    harness.reach("HOMED")
    harness.io.drop_power()
    harness.until(lambda: harness.arm.state == "FAULT")
    assert harness.cell.reported == ["fault"]


def test_a_power_off_spares_the_command_that_it_is_part_of() -> None:
    harness = VoidedHarness()
    harness.reach("ENABLED")
    harness.state_command("disable")
    assert harness.cell.reported == ["off by 1"]


def test_leaving_fault_voids_nothing() -> None:
    harness = VoidedHarness()
    harness.reach("FAULT")
    harness.cell.reported.clear()
    harness.state_command("enable")
    harness.until(lambda: harness.arm.state == "ENABLED")
    assert harness.cell.reported == []


def test_a_restart_of_io_voids_what_an_arm_without_power_was_asked_for() -> None:
    harness = VoidedHarness()
    harness.run(0.1)
    harness.io.restart()
    harness.run(0.1)
    assert harness.arm.state == "DISABLED" and harness.cell.reported == ["fault"]


def test_an_arm_that_waits_for_io_does_not_power_up_when_that_comes_back() -> None:
    harness = VoidedHarness()
    harness.run(0.1)
    harness.io.flag("amps_on", True)  # it cannot begin yet
    request = harness.state_command("enable")
    assert harness.arm.state == "DISABLED" and harness.arm.machine.desired == "ENABLED"
    harness.io.restart()
    harness.run(1.0)
    assert harness.arm.state == "DISABLED" and request.outcomes == ["accepted", "failed"]


def test_io_hears_whose_command_an_arm_carries_out() -> None:
    harness = ArmHarness()
    harness.run(0.1)
    request = harness.state_command("enable")
    assert harness.io.origin == request.origin


@pytest.mark.parametrize("state", ["DISABLED", "POWERING", "ENABLED", "HOMING", "PAUSED", "FAULT"])
def test_a_hold_voids_what_was_asked_for_before(state: str) -> None:
    harness = VoidedHarness()
    harness.reach(state)
    harness.cell.reported.clear()
    assert harness.send("hold").outcomes[-1] == "done"
    assert harness.cell.reported == ["off by 1"]


def test_a_hold_of_a_homed_arm_ends_its_motion_only() -> None:
    harness = VoidedHarness()
    harness.reach("HOMED")
    harness.cell.reported.clear()
    harness.send("hold")
    assert harness.cell.reported == []


def test_a_hold_of_an_arm_that_waits_for_io_leaves_it_without_power() -> None:
    harness = VoidedHarness()
    harness.run(0.1)
    harness.io.flag("amps_on", True)  # it cannot begin yet
    enable = harness.state_command("enable")
    assert harness.send("hold").outcomes == ["done"]
    harness.io.flag("amps_on", False)
    harness.run(1.0)
    assert harness.arm.state == "DISABLED" and enable.replies[-1] == ("failed", "hold was requested")
