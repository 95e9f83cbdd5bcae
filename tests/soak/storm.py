"""The storm: random events over a system that moves, homes, pushes and follows, judged by the boards' own truth.

    python -m tests.soak.storm --seed 1 --events 300

prints the seed, what happened and every violation; exit code 1 when there is one. docs/safety.md says what is promised.
"""

from __future__ import annotations

import argparse
import collections
import math
import os
import random
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from tests.soak import cart, judge, recorder
from tests.soak.cart import CartScene
from tests.soak.diary import Diary
from tests.soak.motion import MotionTruth, Truth, bounds
from tests.soak.person import ROBOTS, StormPerson
from tests.soak.puppets import STREAMS
from tests.soak.scenes import Driven, Effort, Following, Homing, Others, Scene
from tests.soak.system import System, wait_for
from tests.soak.walls import WallScene
from tests.soak.weather import Weather
from trocar.shm.time.clock import monotonic_ns, pause

PATIENCE_S = 30.0
TRIES = 3
SETPOINTS = [f"{name}.setpoint" for name in ROBOTS]
AGAIN_SHARE = 0.35  # struck again before the person did anything


@dataclass
class Report:
    """What came of a storm."""

    seed: int
    events: collections.Counter[str] = field(default_factory=collections.Counter)
    scenes: collections.Counter[str] = field(default_factory=collections.Counter)
    records: int = 0
    lost: int = 0
    seconds: float = 0.0
    starts: int = 1
    violations: list[str] = field(default_factory=list)
    reported: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        rows = [f"seed {self.seed}: {self.events.total()} events in {self.seconds:.0f} s, "
                f"{self.records} records judged, {self.lost} lost, {self.starts} starts",
                "events: " + ", ".join(f"{name} {count}" for name, count in self.events.most_common()),
                "scenes: " + ", ".join(f"{name} {count}" for name, count in self.scenes.items()),
                f"not back, but reported: {len(self.reported)}", *(f"  {row}" for row in self.reported),
                f"VIOLATIONS: {len(self.violations)}", *(f"  {row}" for row in self.violations)]
        return "\n".join(rows)


class Storm:
    """One run."""

    def __init__(self, seed: int, folder: Path, only: str = "", event: str = "") -> None:
        """`only` this scene, empty: all in turn; of the events only this one, empty: all."""
        self.report, self._only = Report(seed), only
        self.diary = Diary()
        self._chance = random.Random(seed)
        self._end_ns = math.inf
        carts = System(f"cart{os.getpid()}", folder / "cart", cart.FILE, (cart.SHARE,), cart.OF_IO)
        self._walls = WallScene(f"walls{os.getpid()}", folder / "walls", self.diary, self._chance)
        self.system = System(f"storm{os.getpid()}", folder)
        self._person = StormPerson(self.system, self.diary)
        self._cart = CartScene(carts, self.diary, self._chance)
        self._weather = Weather(self.system, self._person, self.diary, self._chance)
        self._weather.only = event

    def run(self, events: int, most_s: float = math.inf) -> Report:
        """So many events, or as many as fit; the system is down and everything judged when it returns."""
        begin = monotonic_ns()
        self._end_ns = begin + min(most_s, 1e6) * 1e9
        try:
            self.system.start()
            scenes = self._scenes()
            while self.report.events.total() < events and monotonic_ns() < self._end_ns:
                scene = scenes[0]
                scenes.append(scenes.pop(0))
                left = events - self.report.events.total()
                self._play(scene, min(left, self._chance.randint(scene.events // 2, scene.events)))
            self._weather.clear()
            self._wrong(self.system.stop())
        finally:
            self._person.stand_up()
            self._cart.end()
            self._walls.end()
            self.system.clean()
        self.report.seconds = (monotonic_ns() - begin) * 1e-9
        self.judge()
        self.diary.keep(self.system.folder / "diary.jsonl")
        return self.report

    def _scenes(self) -> list[Scene]:
        own = (self.system, self._person, self.diary, self._chance)
        scenes: list[Scene] = [Driven("moving", ("move", "joints", *STREAMS), *own),
                               Following(Others(*own), self._person), Homing(*own[1:]),
                               Effort("effort", ("effort", "wrench"), *own)]
        scenes += [self._walls, *([self._cart] if cart.FILE.exists() else [])]
        return [scene for scene in scenes if self._only in ("", scene.name)]

    def _play(self, scene: Scene, events: int) -> None:
        self.diary.note("scene", scene.name)
        self._weather.favourites = scene.victims
        end = self.report.events.total() + events
        while self.report.events.total() < end and monotonic_ns() < self._end_ns:
            if not self._prepare(scene):
                continue
            self.report.scenes[scene.name] += 1
            pause(self._chance.uniform(0.1, 1.0))
            self._strike(scene)
            while self._chance.random() < AGAIN_SHARE and self.system.is_up:
                pause(self._chance.uniform(0.0, 0.5))
                self._strike(scene)
            pause(self._chance.uniform(0.4, 1.0))
        scene.end()

    def _strike(self, scene: Scene) -> None:
        found = {name: event for name, event in scene.client_events().items() if self._weather.only in ("", name)}
        if found and (self._weather.only or self._chance.random() < scene.client_share):
            name = self._chance.choice(list(found))
            words = found[name]()
        else:
            name = self._weather.choose()
            words = self._weather.strike(name)
        self.report.events[name] += 1
        passed_s = (monotonic_ns() - self.diary.entries[0].stamp_ns) * 1e-9
        print(f"{self.report.events.total():4d} {passed_s:7.1f} s {scene.name:10s} {words}", flush=True)
        if name == "supervisor_kill":
            self._wrong(self.system.died())

    def _prepare(self, scene: Scene) -> bool:
        """Bring all back and the scene going; False: it could not be, and was reported."""
        late: list[str] = []
        for _ in range(TRIES):
            if not self.system.is_up:
                scene.end()
                self._begin_anew()
            self._weather.clear()
            wait_for(lambda: not self.system.look() or not self.system.is_up, PATIENCE_S)
            wrong = self.system.look()
            late = [f"{name} is {how}" for name, how in wrong.items()]
            if not wrong:
                problem = scene.keep()
                if not problem:
                    return True
                late = [problem]
            self.diary.note("problem", "; ".join(late))
            print(f"     not back yet: {'; '.join(late)[:300]}", flush=True)
        last = self.diary.before(monotonic_ns(), "event")
        row = f"after {last.words if last else 'nothing'}: {'; '.join(late) or 'no reason told'}"
        (self.report.reported if any(late) else self.report.violations).append(row)
        scene.end()
        self._wrong(self.system.stop())
        self._begin_anew()
        return False

    def _begin_anew(self) -> None:
        self._wrong(self.system.died())
        self._weather.forget()
        self.diary.lose(ROBOTS, "a new system")
        self.diary.note("state", "up again")
        self.system.start()
        self.report.starts += 1

    def _wrong(self, found: list[str]) -> None:
        last = self.diary.before(monotonic_ns(), "event")
        self.report.violations += [f"{row}; after {last.words if last else 'nothing'}" for row in found]

    def judge(self) -> None:
        """By all that was recorded."""
        document = self.system.document
        assert document.emulation is not None
        robots = [MotionTruth(document, document.arm(name)) for name in ROBOTS]
        found: list[judge.Violation] = []
        diary, asks = self.diary, self.diary.asks()
        for path in self.system.records:
            truth, io, *arms = (self._read(each) for each in (
                path, *(recorder.beside(path, f"{name}") for name in ("IO1.state", *SETPOINTS))))
            motions = [robot.motion(truth, document.emulation.period_s) for robot in robots]
            for robot, motion, arm in zip(robots, motions, arms, strict=True):
                found += judge.too_fast(motion, asks, motions, diary.deaths(robot.name))
                found += judge.powered_by_nobody(robot, truth, diary.commands, diary.losses)
                found += judge.lost_by_numbers(robot, truth, io, diary.numbers, diary.done(robot.name, diary.numbers))
                found += judge.unprotected(robot, truth, io, diary.attempts, diary.commands)
                for setpoints in (robot.setpoints(io), robot.asked(arm)):
                    found += judge.beyond_bounds(setpoints, bounds(robot.kind))
                    found += judge.continued(setpoints, diary.stops, asks)
        found += judge.obtained(diary.attempts) + self._cart.judge() + self._walls.judge()
        self._wrong(self._cart.wrong + self._walls.wrong)
        begin = self.diary.entries[0].stamp_ns
        for each in sorted(found, key=lambda violation: violation.stamp_ns):
            last, scene = (self.diary.before(each.stamp_ns, kind) for kind in ("event", "scene"))
            ago = f", {(each.stamp_ns - last.stamp_ns) * 1e-9:.2f} s before" if last is not None else ""
            self.report.violations.append(
                f"{(each.stamp_ns - begin) * 1e-9:7.2f} s {each.robot} {each.mode} ({scene.words if scene else '-'}): "
                f"{each.value:.4f} > {each.limit:.4f} {each.what}; event: {last.words if last else 'none'}{ago}")

    def _read(self, path: Path) -> Truth:
        truth, lost = recorder.read(path)
        self.report.records += len(truth)
        self.report.lost += lost
        return truth


def main() -> None:
    """By hand."""
    parser = argparse.ArgumentParser(prog="tests.soak.storm", description=__doc__)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 30))
    parser.add_argument("--events", type=int, default=300)
    parser.add_argument("--seconds", type=float, default=math.inf, help="begin no event after so many")
    parser.add_argument("--scene", default="", help="one scene only: moving, following, homing, effort, walls, cart")
    parser.add_argument("--event", default="", help="one kind of event only, e.g. pause, foreign_hold")
    parser.add_argument("--folder", type=Path, help="where logs, diary and records stay; default: a temporary one")
    chosen = parser.parse_args()
    print(f"seed {chosen.seed}, {chosen.events} events", flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        report = Storm(chosen.seed, folder, chosen.scene, chosen.event).run(chosen.events, chosen.seconds)
    print(report.text())
    sys.exit(1 if report.violations else 0)


if __name__ == "__main__":
    main()
