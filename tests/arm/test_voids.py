"""What makes older commands to an arm void: faults, power-offs, another io; and whose commands it passes on to io."""

from __future__ import annotations

from shm.faults import NoFaults
from tests.arm.fake_io import Rig


class Cell(NoFaults):
    """Remembers what happened."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def fault(self) -> None:
        self.said.append("fault")

    def switched_off(self, origin: int) -> None:
        self.said.append(f"off by {origin}")




class Watched(Rig):
    """An arm whose faults are counted."""

    def __init__(self) -> None:
        super().__init__()
        self.cell = Cell()
        self.start_arm()

    def start_arm(self) -> None:
        super().start_arm()
        object.__setattr__(self.arm._around, "faults", getattr(self, "cell", NoFaults()))


def test_a_fault_voids_what_was_asked_for_before() -> None:
    rig = Watched()
    rig.reach("HOMED")
    rig.io.drop_power()
    rig.until(lambda: rig.arm.state == "FAULT")
    assert rig.cell.said == ["fault"]


def test_a_power_off_spares_the_command_that_it_is_part_of() -> None:
    rig = Watched()
    rig.reach("ENABLED")
    rig.state_command("disable")
    assert rig.cell.said == ["off by 1"]


def test_leaving_fault_voids_nothing() -> None:
    rig = Watched()
    rig.reach("FAULT")
    rig.cell.said.clear()
    rig.state_command("enable")
    rig.until(lambda: rig.arm.state == "ENABLED")
    assert rig.cell.said == []


def test_a_restart_of_io_voids_what_an_arm_without_power_was_asked_for() -> None:
    rig = Watched()
    rig.run(0.1)
    rig.io.restart()
    rig.run(0.1)
    assert rig.arm.state == "DISABLED" and rig.cell.said == ["fault"]


def test_an_arm_that_waits_for_io_does_not_power_up_when_that_comes_back() -> None:
    rig = Watched()
    rig.run(0.1)
    rig.io.flag("amps_on", True)  # it cannot begin yet
    request = rig.state_command("enable")
    assert rig.arm.state == "DISABLED" and rig.arm.machine.desired == "ENABLED"
    rig.io.restart()
    rig.run(1.0)
    assert rig.arm.state == "DISABLED" and request.outcomes == ["accepted", "failed"]


def test_io_hears_whose_command_an_arm_carries_out() -> None:
    rig = Rig()
    rig.run(0.1)
    request = rig.state_command("enable")
    assert rig.io.origin == request.origin
