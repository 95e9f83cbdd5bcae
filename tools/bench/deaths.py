"""`trocar bench deaths`: every row of "Failure modes" (docs/architecture.md) killed and stopped, and the times of the
effects.

Three systems on the wall clock, one after the other: an arm and a lens on emulated boards; a master, a slave on setup
joints, a console and a user's process without boards, following; and a master that is a third-party program. `kill` is
SIGKILL, `stop` SIGSTOP. `…_noticed_ms` is from the signal to the first record of another process that shows the effect,
`…_back_s` until another process runs in its place; for the supervisor `…_ended_s` until no process runs any more.
Medians of some tries, each of a process that has run for a while (after quick crashes the wait is longer); a process
without effect on others has no `noticed`, one that we do not start has no `back`.
"""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
import yaml
from numpy.typing import NDArray

from trocar.procs.machine.paths import PROJECT_CONFIGS, ROOT
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.tools.bench.measuring import PATIENCE_S, home_all, seconds_since, wait_until
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.processes import statuses
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import table
from trocar.tools.systems.cleanup import own_folder
from trocar.tools.systems.find import environment
from trocar.tools.systems.processes import CONTINUE, KILL
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

STOP: Final = 19
SIGNALS: Final = {"kill": KILL, "stop": STOP}
TRIES, EFFORT = 3, 3
REST_NS: Final = 10_500_000_000  # then the next crash counts as the first (procs/supervisor/children.py)
CONFIGS: Final = PROJECT_CONFIGS
OUTPUTS: Final = ("endoscope_focus_in", "endoscope_focus_out")
TELEOP: Final = "MTMR_PSM1"
USER: Final = "def main(process):\n    while process.tick():\n        pass\n"
PUSHER: Final = """
import sys, time, trocar
with trocar.arm("PSM1", system=sys.argv[1]) as arm:
    while True:
        arm.servo_jf([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
        time.sleep(0.01)
"""
STRIKES: Final = tuple(how for how in SIGNALS for _ in range(TRIES))
Records = NDArray[Any]
Shows = Callable[[Records], Any]


@dataclass(frozen=True, slots=True)
class DeathEffect:
    """Effect of a crash on other processes, and the record that shows it from then on."""

    words: str
    instance: str
    shows: Shows

    def since(self, system: str, begin_ns: int) -> float:
        """When it showed for the first time, s after `begin_ns`."""
        with contextlib.closing(directory.reader(system, self.instance, "state")) as ring:
            return wait_until(lambda: self._found(ring.since(begin_ns), begin_ns), self.words)

    def _found(self, records: Records, begin_ns: int) -> float:
        """0: not yet."""
        if len(records) < 2:
            return 0.0
        shown = np.flatnonzero(self.shows(records))
        return max(1, int(records["stamp_ns"][shown[0]]) - begin_ns) * 1e-9 if len(shown) else 0.0


@dataclass(frozen=True, slots=True)
class Death:
    """A row: the process, the effect of its crash; `ready` brings the system to the relevant state."""

    who: str
    instance: str
    ready: Callable[[str], None]
    effect: DeathEffect | None = None


@dataclass(frozen=True, slots=True)
class Timed:
    """One crash: seconds until it showed, and until it was over; None: it does not, or is not."""

    who: str
    how: str
    words: str
    noticed_s: float | None
    over_s: float | None
    over: str = "back"


def _stands(records: Records) -> NDArray[np.bool_]:
    """From when on the setpoint does not move any more, for 0.2 s at least."""
    moves = np.flatnonzero(np.abs(np.diff(records["setpoint_cp"][:, :3], axis=0)).max(axis=1) > 0.0)
    last = moves[-1] + 1 if len(moves) else 0
    stamps = records["stamp_ns"]
    shown: NDArray[np.bool_] = (np.arange(len(records)) >= last) & (stamps[-1] - stamps[last] > 200_000_000)
    return shown


FAULT = DeathEffect("the arm is in FAULT", "PSM1", lambda records: records["state"] == b"FAULT")
NOT_FOLLOWING = DeathEffect("following ends", TELEOP, lambda records: ~records["following"])


def run() -> dict[str, Any]:
    """Measure."""
    with own_folder(f"bench-deaths-{os.getpid()}") as folder:
        timed = [*_on_boards(folder), *_following(folder), *_third_party(), *_supervisor(folder)]
    figures: dict[str, float] = {}
    for each in dict.fromkeys((row.who, row.how) for row in timed):
        rows = [row for row in timed if (row.who, row.how) == each]
        key = _key(*each)
        if noticed := [row.noticed_s for row in rows if row.noticed_s is not None]:
            figures[f"{key}_noticed_ms"] = statistics.median(noticed) * 1e3
        if over := [row.over_s for row in rows if row.over_s is not None]:
            figures[f"{key}_{rows[0].over}_s"] = statistics.median(over)
    return {"figures": figures, "effects": {row.who: row.words for row in timed}, "conditions": {"tries": TRIES}}


def _key(who: str, how: str) -> str:
    return f"{who.replace(' ', '_').replace(chr(39), '')}_{how}"


def show(result: dict[str, Any]) -> None:
    """The table of docs/architecture.md."""
    figures, rows = result["figures"], []
    for who, words in result["effects"].items():
        cells = [who, words]
        for how in SIGNALS:
            key = _key(who, how)
            noticed = figures.get(f"{key}_noticed_ms")
            over = figures.get(f"{key}_back_s", figures.get(f"{key}_ended_s"))
            cells += [f"{noticed:.0f} ms" if noticed is not None else "–", f"{over:.1f} s" if over is not None else "–"]
        rows.append(tuple(cells))
    table("who dies, and when others notice", ("who", "what shows", "kill: noticed", "over", "stop: noticed", "over"),
          rows, right=("kill: noticed", "over", "stop: noticed"))


def _on_boards(folder: Path) -> Iterator[Timed]:
    with up_meanwhile(_boards_request(folder)) as up:
        def focusing(system: str) -> None:
            with Remote(system, "lens") as lens:
                wait_until(lambda: lens.answered("focus_in", (1.0,)).outcome == "done", "the lens moves")
            _until(system, "IO1", lambda record: not record["output"][places].all(), "its output is on")

        with contextlib.closing(directory.reader(up.system, "IO1", "state")) as ring:
            places = [ring.info["outputs"].index(name) for name in OUTPUTS]
        rests = DeathEffect("the lens rests", "IO1", lambda records: records["output"][:, places].all(axis=1))
        holds = DeathEffect("io holds the robot", "IO1", lambda records: records["holding"].any(axis=1))
        yield from _each(up.system, (
            Death("an arm", "PSM1", _home, holds), Death("the focus controller", "lens", focusing, rests),
            Death("io", "IO1", _home, FAULT), Death("boards", "boards", _home, FAULT)))
        ends = DeathEffect("its effort ends", "PSM1", lambda records: records["control_mode"] != EFFORT)
        for how in STRIKES:
            _home(up.system)
            with _program([sys.executable, "-c", PUSHER, up.system]) as pusher:
                _until(up.system, "PSM1", lambda record: record["control_mode"] == EFFORT, "the arm is pushed")
                yield Timed("a script", how, ends.words, ends.since(up.system, _strike(pusher.pid, how)), None)


def _following(folder: Path) -> Iterator[Timed]:
    content = yaml.safe_load((CONFIGS / "systems/kinematic-teleop.yaml").read_text())
    carried = yaml.safe_load((CONFIGS / "systems/kinematic-cart.yaml").read_text())["arms"]
    content["arms"] = [content["arms"][0], *carried[:3]]
    (row,) = content["consoles"][0]["teleop_PSMs"]
    row["configure_parameter"]["align_MTM"] = False
    row["PSM_base_frame"] = {"component": "SUJ", "interface": "PSM1"}
    content["trocar"] = {"processes": {"user": {"module": "user.py", "hung_s": 1.0}}}
    (folder / "user.py").write_text(USER)
    (folder / "following.yaml").write_text(yaml.safe_dump(content))
    to_and_fro = [0]

    def follows(system: str) -> None:
        """The master moves for some seconds, and the slave follows."""
        _follow(system)
        to_and_fro[0] += 1
        with Remote(system, "MTMR") as master, contextlib.closing(directory.reader(system, "MTMR", "state")) as ring:
            master.answered("trajectory_j/set_ratio", (0.02,))
            wait_until(ring.newest, "the master's record")
            goal = ring.field("setpoint_position")[:7].copy()
            goal[0] += 0.3 * (-1) ** to_and_fro[0]
            master.ask("move_jp", goal)
        stands = DeathEffect("", "PSM1",
                             lambda records: np.abs(np.diff(records["setpoint_cp"][:, 0], prepend=np.nan)) > 0.0)
        stands.since(system, monotonic_ns())

    file = folder / "following.yaml"
    with up_meanwhile(StartRequest(file, f"bench-deaths-{os.getpid()}", sets=("clock=wall",))) as up:
        with Remote(up.system, "system") as remote:
            if (reply := remote.settled("home", timeout=PATIENCE_S)).outcome != "done":
                raise Problem(f"home: {reply.text}")
        yield from _each(up.system, (
            Death("a teleoperation", TELEOP, follows, DeathEffect("the slave stands", "PSM1", _stands)),
            Death("a console", "console", follows, NOT_FOLLOWING), Death("setup joints", "SUJ", follows, NOT_FOLLOWING),
            Death("the system's process", "system", _follow), Death("a process of your own", "user", _follow)))


def _third_party() -> Iterator[Timed]:
    file, recording = CONFIGS / "systems/third-party-master.yaml", CONFIGS / "recordings/circle.csv"
    words = [sys.executable, "-m", "trocar.tools.examples.recorded_master", str(recording), "--times", "1000",
             "--press", "operator_present", "--system"]
    with up_meanwhile(StartRequest(file, f"bench-deaths-{os.getpid()}")) as up:
        with Remote(up.system, "system") as remote:
            remote.settled("home", timeout=PATIENCE_S)
        with Remote(up.system, "console") as console:
            console.answered("teleop_enable", (1.0,))
        for how in STRIKES:
            with _program([*words, up.system]) as program:
                _until(up.system, TELEOP, lambda record: bool(record["following"]), "following")
                noticed_s = NOT_FOLLOWING.since(up.system, _strike(program.pid, how))
            yield Timed("a program of yours", how, NOT_FOLLOWING.words, noticed_s, None)


def _supervisor(folder: Path) -> Iterator[Timed]:
    for how in STRIKES:
        with up_meanwhile(_boards_request(folder)) as up:
            _home(up.system)
            others = [row.pid for row in statuses(up.system) if row.pid and row.kind != "supervisor"]
            with contextlib.closing(ControlPage(up.system, "IO1")) as io:
                begin = _strike(up.popen.pid, how)
                wait_until(lambda io=io: io.state == "STOPPED", "io has ended")  # type: ignore[misc]
                noticed_s = seconds_since(begin)
            wait_until(lambda others=others: not any(map(_lives, others)), "all have ended")  # type: ignore[misc]
            ended_s = seconds_since(begin)
            with contextlib.suppress(ProcessLookupError):  # one that was stopped finds its processes gone, and ends
                os.kill(up.popen.pid, CONTINUE)
            up.popen.wait(PATIENCE_S)
        yield Timed("the supervisor", how, "io has powered off, and ended", noticed_s, ended_s, "ended")


def _boards_request(folder: Path) -> StartRequest:
    content = yaml.safe_load((CONFIGS / "systems/demo.yaml").read_text())
    content["ISI_focus_controller"] = {"name": "lens", "IO": "IO1", "IO_file": "lens.json"}
    rows = [{"name": name, "board_id": 6, "bit_id": bit, "is_PWM": False} for bit, name in enumerate(OUTPUTS)]
    (folder / "lens.json").write_text(
        json.dumps({"$id": "saw-robot-io.schema.json", "$version": "6", "digital_outputs": rows}))
    (folder / "boards.yaml").write_text(yaml.safe_dump(content))
    return StartRequest(folder / "boards.yaml", f"bench-deaths-{os.getpid()}", "emulated", sets=("clock=wall",))


def _each(system: str, deaths: tuple[Death, ...]) -> Iterator[Timed]:
    """All of them by turns; a process that has just restarted is left alone."""
    rested = dict.fromkeys((death.instance for death in deaths), monotonic_ns() + REST_NS)
    for how in SIGNALS:
        for death in deaths * TRIES:
            wait_until(lambda at=rested[death.instance]: monotonic_ns() >= at, "rest")  # type: ignore[misc]
            death.ready(system)
            begin = _strike(old := _pid(system, death.instance), how)
            wait_until(lambda death=death, old=old: _pid(system, death.instance, "RUNNING") not in (0, old),  # type: ignore[misc]
                       f"{death.who} is back")
            over_s, effect = seconds_since(begin), death.effect
            rested[death.instance] = monotonic_ns() + REST_NS
            noticed_s = effect.since(system, begin) if effect is not None else None
            yield Timed(death.who, how, effect.words if effect is not None else "nothing", noticed_s, over_s)


def _pid(system: str, instance: str, state: str = "") -> int:
    """0: there is none, or not in that state."""
    with contextlib.closing(ControlPage(system, instance)) as page:
        return int(page.get("pid")) if state in ("", page.state) else 0


def _home(system: str) -> None:
    """PSM1, which may be just back."""
    home_all(system, "PSM1")


def _follow(system: str) -> None:
    """The operator leaves and returns, and the teleoperation follows."""
    with Remote(system, "console") as console:
        console.answered("teleop_enable", (1.0,))
        console.answered("emulate_operator_present", (0.0,))
        _until(system, "console", lambda record: not record["operator_present"], "the operator has gone")
        console.answered("emulate_operator_present", (1.0,))
    _until(system, TELEOP, lambda record: bool(record["following"]), "following")


def _strike(pid: int, how: str) -> int:
    begin = monotonic_ns()
    os.kill(pid, SIGNALS[how])
    return begin


@contextlib.contextmanager
def _program(words: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    started = subprocess.Popen(words, cwd=ROOT, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield started
    finally:
        started.kill()
        started.wait()


def _lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _until(system: str, instance: str, true: Callable[[Any], bool], what: str) -> None:
    with contextlib.closing(directory.reader(system, instance, "state")) as ring:
        wait_until(lambda: len(last := ring.last(1)) and true(last[0]), what)
