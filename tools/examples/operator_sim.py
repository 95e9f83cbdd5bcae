"""The operator at a console: shows presence, enables teleoperation, selects, and reads each teleoperation's state."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.shm.mailbox.client import Client
from trocar.shm.memory.closable import Closable
from trocar.shm.system import directory
from trocar.shm.time.clock import pause
from trocar.shm.time.system_time import Patience
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import plain
from trocar.tools.systems.find import instances_of_kind

POLL_S = 0.01
SWAY_RAD, SWAY_S = 0.05, 4.0  # of a master without a robot: amplitude and period
PATIENCE_S = 30.0  # alignment of a master far off takes some seconds


class SeenRecord:
    """The newest record of an instance."""

    def __init__(self, system: str, name: str, kind: str) -> None:
        self.name = name
        self.ring = directory.reader(system, name, "state", kind, often=False)

    def value(self, field: str) -> Any:
        """A field of the newest record as a Python value; Problem: there is none."""
        if not self.ring.newest():
            raise Problem(f"{self.name}: its state cannot be read: {self.ring.problem or 'it has shown none'}")
        return plain(self.ring.field(field))


class SimTeleop(SeenRecord):
    """A teleoperation's record."""

    def __init__(self, system: str, name: str) -> None:
        super().__init__(system, name, "teleop")
        self.kind = str(self.value("kind"))
        self.masters = [str(master) for master in self.value("masters") if master]
        self.slave = str(self.value("slave"))

    @property
    def is_following(self) -> bool:
        """Whether the slave follows."""
        return bool(self.value("following"))

    @property
    def shown_state(self) -> str:
        """Its state, in words."""
        return f"{self.name} is {self.value('state')}"

    @property
    def reported(self) -> str:
        """Its state, and the condition it waits for."""
        reason = self.value("reason")
        return self.shown_state + (f" ({reason})" if reason else "")


class OperatorSim(Closable):
    """One console with its teleoperations; a context manager."""

    def __init__(self, system: str, console: str) -> None:
        self._stack, self._system = contextlib.ExitStack(), system
        self.console = SeenRecord(system, console, "console")
        self._stack.callback(self.console.ring.close)
        self._remote = self._stack.enter_context(Remote(system, console))
        self.teleops: list[SimTeleop] = []
        for name in self.console.value("teleop"):
            self.teleops.append(SimTeleop(system, str(name)))
            self._stack.callback(self.teleops[-1].ring.close)

    @property
    def chosen(self) -> list[SimTeleop]:
        """Teleoperations that are selected."""
        selected = self.console.value("selected")
        return [teleop for teleop, is_selected in zip(self.teleops, selected, strict=True) if is_selected]

    def expected(self) -> list[SimTeleop]:
        """Those that follow now if all is well: by the camera pedal those of PSMs or those of the ECM."""
        kind = "ECM" if self.console.value("camera") else "PSM"
        return [teleop for teleop in self.chosen if teleop.kind == kind]

    def begin(self) -> None:
        """Sit down and enable teleoperation."""
        self.ask("emulate_operator_present", 1)
        self.ask("teleop_enable", 1)

    def ask(self, command: str, *values: float, text: str = "") -> None:
        """A command of the console; Refused gives the reason."""
        self._remote.ask(command, values, text)

    def wait(self, seconds: float = PATIENCE_S) -> None:
        """Wait until all selected ones follow; Problem gives the obstacle."""
        with Patience(self._system, seconds) as patience:
            while waiting := [teleop for teleop in self.expected() if not teleop.is_following]:
                if patience.is_over:
                    raise Problem(f"after {seconds:g} s {'; '.join(teleop.reported for teleop in waiting)}")
                pause(POLL_S)

    def try_all(self) -> list[str]:
        """Make every teleoperation follow once, then those that did before; the names of all that followed."""
        before, found = self.chosen, {teleop.name for teleop in self.expected()}
        for teleop in self.teleops:
            if teleop.kind == "PSM" and teleop.name not in found:
                self.ask("select_teleop", text=teleop.name)
                self.wait()
                found |= {each.name for each in self.expected()}
        for teleop in before:
            self.ask("select_teleop", text=teleop.name)
        self.wait()
        if any(teleop.kind == "ECM" for teleop in before):
            self.ask("emulate_camera", 1)
            self.wait()
            found |= {each.name for each in self.expected()}
            self.ask("emulate_camera", 0)
            self.wait()
        return [teleop.name for teleop in self.teleops if teleop.name in found]

    def close(self) -> None:
        """Detach."""
        self._stack.close()


@contextlib.contextmanager
def seats(system: str) -> Iterator[list[OperatorSim]]:
    """Every console of a system."""
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(OperatorSim(system, name)) for name in instances_of_kind(system, "console")]


class Sway:
    """A master without a robot, moved by its joints all the time: each swings about its initial position."""

    def __init__(self, system: str, master: str) -> None:
        """Every joint has a phase of its own."""
        self.name = master
        arm = SeenRecord(system, master, "arm")
        count = int(arm.value("count"))
        self._centre: NDArray[np.float64] = np.array(arm.value("setpoint_position")[:count])
        arm.ring.close()
        self._phases = np.arange(count) * 0.8
        self._client = Client(system, master)

    def step(self, passed_s: float) -> None:
        """Its position this long after the beginning; it starts from the initial one."""
        swing = np.sin(2.0 * np.pi / SWAY_S * passed_s + self._phases) - np.sin(self._phases)
        self._client.poll()
        self._client.send("servo_jp", self._centre + SWAY_RAD * min(1.0, passed_s) * swing)

    def close(self) -> None:
        """Stop moving it."""
        self._client.close()
