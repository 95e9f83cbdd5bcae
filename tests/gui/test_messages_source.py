"""What processes say, and the remedy of an arm's last error."""

from __future__ import annotations

from contextlib import closing

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.document.system import from_json
from trocar.procs.gui.messages_source import KEPT, LOOK_NS, MessagesSource
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import Code
from trocar.shm.system import directory
from trocar.shm.system.events import Events
from trocar.shm.time.clock import monotonic_ns


def test_the_remedy_of_an_arm_is_that_of_its_own_last_error_however_long_ago(world: World) -> None:
    with robot(world.name) as scripted:
        io = Events(directory.writer(world.name, "IO1", "events", "io"), monotonic_ns)
        document = from_json(directory.document(world.name))

        def report(events: Events, code: Code, component: str) -> None:
            events.report(code, f"{component} has something, as PSM1 had", component)

        report(io, codes.TRACKING, "PSM1")
        for _ in range(KEPT // 2 + 5):
            io.status("nothing of note")
        with closing(MessagesSource(document)) as source:
            now = 0

            def remedies() -> dict[str, str]:
                nonlocal now
                now += LOOK_NS
                found: dict[str, str] = source.read(now)["remedies"]
                return found

            assert remedies() == {"PSM1": codes.TRACKING.remedy_for("PSM1")}
            report(io, codes.WATCHDOG, "MTMR_PSM1")
            report(io, codes.WATCHDOG, "board 3")
            assert remedies() == {"PSM1": codes.TRACKING.remedy_for("PSM1")}
            report(io, codes.CURRENT, "PSM1")
            for _ in range(3 * KEPT):
                scripted.events.status("nothing of note")
                remedies()
            assert remedies() == {"PSM1": codes.CURRENT.remedy_for("PSM1")}
            report(scripted.events, codes.HOMING_TIMEOUT, "PSM1")
            assert remedies() == {"PSM1": codes.HOMING_TIMEOUT.remedy_for("PSM1")}
