"""A scene of the storm with a system of its own: two PSMs that face each other, with walls that come and go."""

from __future__ import annotations

import contextlib
import random
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.soak import recorder
from tests.soak.diary import Diary
from tests.soak.inside import APART_M, SetpointJudge
from tests.soak.judge import Violation
from tests.soak.person import TROUBLES, StormPerson
from tests.soak.system import System, wait_for
from trocar.procs.machine.paths import ROOT
from trocar.procs.tables.bring_up import HOMED
from trocar.shm.system import directory
from trocar.shm.time.clock import pause
from trocar.tools.client.remote import Remote
from trocar.tools.examples.operator_sim import SeenRecord

Array = Any
PAIR = ("PSM1", "PSM2")
STRUCK = (*PAIR, "IO1", "IO2")
DEMO = ROOT / "configs" / "systems" / "demo-hand-over.yaml"
WALLS = f"""
  walls:
    - {{name: apart, shape: arms, arms: [PSM1, PSM2], margin: {APART_M}}}
    - {{name: table, shape: plane, position: [0, 0, -0.03], frame: reference}}
"""
RECORDED = ("is_homed", "control_mode", "setpoint_position", "base_frame")
KEPT = ("count", "name", "shape", "keep", "of", "frame", "pose", "size", "margin", "by_command", "active", "distance")
WITNESSED = tuple(f"{arm}.{topic}:arm:{','.join(fields)}" for arm in PAIR
                  for topic, fields in (("state", RECORDED), ("walls", KEPT)))
PLACE, REACH = (0.0, 0.0, 0.13, 0.0, 0.0, 0.0), (0.3, 0.3, 0.04, 0.5, 0.4, 0.4)
SPEED = np.array((0.4, 0.4, 0.06, 1.0, 1.0, 1.0))  # rad/s, m/s: of the streams
BEAT_S = 0.01
LEAVING_S = 1.0
OUT_M_S = 0.04


class Streams(threading.Thread):
    """Streams and moves of both arms to random places, until the end; `leaving`: not this arm."""

    def __init__(self, system: str, chance: random.Random) -> None:
        super().__init__(daemon=True)
        self._system, self._chance = system, random.Random(chance.random())
        self.leaving, self.over = "", threading.Event()

    def run(self) -> None:
        """See the class."""
        while not self.over.wait(BEAT_S):
            with contextlib.suppress(*TROUBLES), contextlib.ExitStack() as stack:
                arms = {name: stack.enter_context(Remote(self._system, name)) for name in PAIR}
                seen = {name: stack.enter_context(contextlib.closing(SeenRecord(self._system, name, "arm").ring))
                        for name in PAIR}
                self._play(arms, seen)

    def _play(self, arms: Mapping[str, Remote], seen: Mapping[str, Any]) -> None:
        goals, ends = dict[str, Array](), dict[str, Array]()
        while not self.over.wait(BEAT_S):
            for name, arm in arms.items():
                if any(reply.outcome in ("refused", "failed") for reply in arm.replies()) or name == self.leaving:
                    goals.pop(name, None)
                if name == self.leaving:
                    continue
                if name not in goals:
                    seen[name].newest()
                    goals[name] = np.array(seen[name].field("setpoint_position")[:6])
                    ends[name] = self._anywhere()
                    if self._chance.random() < 0.2:
                        arm.send("move_jp", self._anywhere())
                        self.over.wait(self._chance.uniform(0.1, 1.0))
                way = ends[name] - goals[name]
                if (np.abs(way) < 1e-6).all():
                    ends[name] = self._anywhere()
                goals[name] = goals[name] + np.clip(way, -BEAT_S * SPEED, BEAT_S * SPEED)
                arm.send("servo_jp", goals[name])

    def _anywhere(self) -> Array:
        return np.array([place + reach * self._chance.uniform(-1.0, 1.0)
                         for place, reach in zip(PLACE, REACH, strict=True)])


class WallScene:
    """See Scene; the processes of its system are struck by itself."""

    name, events, client_share = "walls", 12, 1.0
    victims: Sequence[str] = ()

    def __init__(self, name: str, folder: Path, diary: Diary, chance: random.Random) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "walls.yaml"
        file.write_text(DEMO.read_text() + WALLS)
        self._system = System(name, folder, file, (ROOT / "configs",), WITNESSED)
        self._diary, self._chance = diary, chance
        self._person = StormPerson(self._system, Diary())
        self._streams: Streams | None = None
        self._is_up = False
        self._added = 0
        self.wrong: list[str] = []  # after its end, and arms that could not leave

    def keep(self) -> str:
        """See Scene."""
        if not self._is_up:
            self._system.start()
            self._is_up = True
        wait_for(lambda: not self._system.look(), 30.0)
        problems = self._person.bring(HOMED, PAIR)
        if not problems and self._streams is None:
            self._streams = Streams(self._system.name, self._chance)
            self._streams.start()
        return str(problems) if problems else ""

    def client_events(self) -> Mapping[str, Callable[[], str]]:
        """See Scene."""
        found = {"wall_kill": lambda: self._strike(0.0), "wall_remove": self._remove, "wall_base": self._base,
                 "wall_pause": lambda: self._strike(self._chance.uniform(0.01, 0.5)), "wall_leave": self._leave}
        return {**found, "wall_add": self._add, "wall_add_two": self._add}

    def _note(self, words: str) -> str:
        self._diary.note("event", words)
        return words

    def _strike(self, length_s: float) -> str:
        who = self._chance.choice(STRUCK)
        words = self._note(f"{f'stop {who} for {length_s * 1e3:.0f} ms' if length_s else f'kill {who}'}, with walls")
        self._system.signal(who, signal.SIGSTOP if length_s else signal.SIGKILL)
        pause(length_s)
        self._system.signal(who, signal.SIGCONT)
        return words

    def _tip(self, arm: str) -> Array:
        seen = SeenRecord(self._system.name, arm, "arm")
        try:
            return np.array(seen.value("local_setpoint_cp"))
        finally:
            seen.ring.close()

    def _put(self, arm: str, place: Array, size: Sequence[float], words: str) -> str:
        self._added += 1
        name = f"w{self._added}"
        refused = self._person.report(arm, "add_wall", (*place, 0.0, 0.0, 0.0, 1.0, *size), f"{name} {words}")
        return self._note(f"add_wall {name} {words} of {arm}{f' ({refused})' if refused else ''}")

    def _add(self) -> str:
        arm = self._chance.choice(PAIR)
        shape, count = self._chance.choice((("sphere", 1), ("box", 3), ("cylinder", 2), ("capsule", 2), ("plane", 0)))
        size = [self._chance.uniform(0.005, 0.03) for _ in range(count)]
        off = [self._chance.uniform(-0.04, 0.04) for _ in range(3)]
        with contextlib.suppress(*TROUBLES):
            place = self._tip(arm)[:3] + off
            if shape == "plane":
                place[2] = min(place[2], -0.17)
            return self._put(arm, place, size, f"{shape} {self._chance.choice(('tip', 'jaw', 'shaft', 'instrument'))}")
        return "no tip"

    def _remove(self) -> str:
        arm = self._chance.choice(PAIR)
        return self._note(f"remove_wall: {self._remove_all(arm)} of {arm}")

    def _remove_all(self, arm: str) -> int:
        return sum(not self._person.report(arm, "remove_wall", (), name) for name in self._walls(arm)
                   if name.startswith("w"))

    def _walls(self, arm: str) -> dict[str, float]:
        """Walls of an arm, with the distance of its setpoint from each."""
        with contextlib.closing(directory.reader(self._system.name, arm, "walls", "arm", often=False)) as ring:
            ring.newest()
            names = [bytes(name).rstrip(b"\0").decode() for name in ring.field("name")]
            return dict(zip(names, ring.field("distance").tolist(), strict=True))

    def _base(self) -> str:
        arm, step = self._chance.choice(PAIR), self._chance.uniform(-0.01, 0.01)
        try:
            seen = SeenRecord(self._system.name, arm, "arm")
            base, frame = np.array(seen.value("base_frame")), str(seen.value("reference_frame"))
            seen.ring.close()
        except TROUBLES as problem:
            return str(problem)
        base[0] = np.clip(base[0] + step, -0.0951, 0.0951)
        refused = self._person.report(arm, "set_base_frame", base.tolist(), frame)
        return self._note(f"base frame of {arm} {step * 1e3:.1f} mm off{f' ({refused})' if refused else ''}")

    def _leave(self) -> str:
        """A wall comes about the tip of an arm, which leaves it along its shaft."""
        arm = self._chance.choice(PAIR)
        if self._streams is None:
            return "no streams"
        self._streams.leaving = arm
        pause(0.3)
        try:
            self._remove_all(arm)
            place = self._tip(arm)[:3]
            words = self._put(arm, place * (1.0 + 0.004 / np.linalg.norm(place)), (0.01,), "sphere tip")
            pause(0.1)
            begin = self._walls(arm)[f"w{self._added}"]
            with Remote(self._system.name, arm) as remote:
                seen = SeenRecord(self._system.name, arm, "arm")
                goal = np.array(seen.value("setpoint_position")[:6])
                seen.ring.close()
                for _ in range(round(LEAVING_S / BEAT_S)):
                    goal[2] -= BEAT_S * OUT_M_S
                    remote.send("servo_jp", goal)
                    pause(BEAT_S)
                last = [f"{reply.outcome} {reply.text}" for reply in remote.replies()][-1:]
            end = self._walls(arm)[f"w{self._added}"]
        except (*TROUBLES, KeyError) as problem:
            return f"could not leave: {problem}"
        finally:
            self._streams.leaving = ""
        words = f"{words}, {begin * 1e3:.1f} mm, left: {end * 1e3:.1f} mm"
        if begin < 0.0 and not end > 0.0:
            self.wrong.append(f"{arm}: {words}, {last}")
        return words

    def judge(self) -> list[Violation]:
        """All setpoints, by all that was recorded."""
        found: list[Violation] = []
        for path in self._system.records:
            states, walls = ([recorder.read(recorder.beside(path, f"{arm}.{topic}"))[0] for arm in PAIR]
                             for topic in ("state", "walls"))
            judges = [SetpointJudge(self._system.document.arm(arm)) for arm in PAIR]
            for each, other, state, there, kept in zip(judges, judges[::-1], states, states[::-1], walls, strict=True):
                found += each.jumps(state) + each.inside(state, kept) + each.apart(other, state, there)
        return found

    def end(self) -> None:
        """See Scene."""
        if self._streams is not None:
            self._streams.over.set()
            self._streams.join()
            self._streams = None
        if self._is_up:
            self._is_up = False
            self.wrong += self._system.stop()
            self._system.clean()
