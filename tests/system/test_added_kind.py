"""What a new kind of process takes: a folder with its door, a row of the manifest, its record and its commands."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest

from tests.system.recipes import Recipe, tree_with
from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]

METRONOME: Recipe = {
    "procs/metronome/loop.py": '''
from trocar.procs.node import runtime


class Loop(runtime.Loop):
    def setup(self) -> None:
        self._state, self._mailbox = self.node.writes("state"), self.node.mailbox()
        self._beats = self._state.field("beats")

    def update(self) -> None:
        self._beats[...] += 1
        for request in self._mailbox.drain(self.node.wall_ns):
            self._beats[...] = request.values[0]
            self.node.events.emit("bar", component=self.node.name)
            request.done()
        self._state.publish(self.node.now_ns)


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
METRONOME_STATE = Topic("state", "metronome", rate_hz=100, depth=100, fields=(
    Field("beats", "<u8", "", "since the first of the bar"),
))

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
    with closing(directory.reader(robot.name, "metronome", "state")) as state:
        wait_for(lambda: state.newest() and state.field("beats") >= 1000000, 60, "its record")
    pid = robot.kill("metronome")
    wait_for(lambda: robot.state("metronome") == "RUNNING" and robot.pid("metronome") != pid, 60, "its restart")
    robot.pids.add(robot.pid("metronome"))
    assert robot.down() == 0
