"""What the page Processes shows of each process."""

from __future__ import annotations

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.document.system import from_json
from trocar.procs.gui.processes_source import LOOK_NS, ProcessesSource
from trocar.shm.system import directory


def test_what_a_process_says_is_wrong_with_it_is_shown_until_it_is_over(world: World) -> None:
    with robot(world.name) as made:
        source = ProcessesSource(from_json(directory.document(world.name)))
        shown = []
        for look, error in enumerate((b"", b"nothing came for a second", b"")):
            made.pages["PSM1"].field("error")[...] = error
            rows = {row["name"]: row for row in source.read((look + 1) * LOOK_NS)["rows"]}
            shown.append(rows["PSM1"]["error"])
            assert rows["IO1"]["error"] == "" and rows["PSM1"]["state"] == "RUNNING"
        source.close()
    assert shown == ["", "nothing came for a second", ""]
