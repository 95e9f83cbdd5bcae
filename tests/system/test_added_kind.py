"""What a new kind of process takes: a folder with its door, a row of the manifest, its record and its commands."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.recipes import Recipe, tree_with
from tests.system.robot import ROOT, Robot, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.simulated]

METRONOME: Recipe = {
    "procs/metronome/loop.py": '''
from trocar.procs.node import runtime


class Loop(runtime.Loop):
    def __init__(self, node: runtime.Node) -> None:
        super().__init__(node)
        self._state, self._mailbox = node.writes("state"), node.mailbox()
        self._beats = self._state.field("beats")

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        self._beats[...] += 1
        for request in self._mailbox.drain(wall_ns):
            self._beats[...] = request.values[0]
            self.node.events.emit("bar", component=self.node.name)
            request.done()
        self._state.publish(now_ns)


def main() -> None:
    runtime.run("metronome", Loop)


if __name__ == "__main__":
    main()
''',
    "procs/tables/manifest.py": (('    Proc("system",', '''
    Proc("metronome", 0.01, 0.03, 3.0, "motion is not affected; restart", events=("bar",),
         instances=lambda system: [ProcessInstance("metronome", after=tuple(io.name for io in system.ios))],
         priority="least", woken=True, budget_us=100),
'''),),
    "shm/topics.py": (("TOPICS: tuple", '''
METRONOME_STATE = Topic("state", "metronome", 100, 1.0, (Field("beats", "<u8", "", "since the first of the bar"),))

'''), ("    IO_STATE, IO_GAINS,", "    METRONOME_STATE,\n")),
    "shm/commands.py": (('    "supervisor": (', '''
    "metronome": (CommandRow("begin", SETTING, "begin a bar with this beat", (Argument("beat"),)),),
'''),),
}


def test_a_kind_of_process_is_added_in_four_files(robot: Robot, tmp_path: Path) -> None:
    assert len(METRONOME) == 4
    robot.root = tree_with(METRONOME, tmp_path / "tree")
    robot.up(ROOT / "configs" / "systems" / "kinematic.yaml", "--set", "trocar.processes.metronome.period_s=0.02")
    wait_for(lambda: robot.state("metronome") == "RUNNING", 60, "it runs")
    assert "begin a bar" in robot.trocar("send", "metronome")
    robot.trocar("send", "metronome", "begin", "1000000")
    assert "metronome/bar" in robot.trocar("list")
    assert json.loads(robot.trocar("echo", "metronome/state", "--json", "--once"))["beats"] >= 1000000
    pid = robot.kill("metronome")
    wait_for(lambda: robot.state("metronome") == "RUNNING" and robot.pid("metronome") != pid, 60, "its restart")
    robot.pids.add(robot.pid("metronome"))
    assert robot.down() == 0
