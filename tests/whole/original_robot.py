"""A robot of the stock share in this process, and what it says in the words of the original's runs.

Each line that `plays` returns is one difference from the original: an event that one of the two has, a state, a value.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from tests.host.hosted import AT_200_HZ
from trocar.procs.config import load_system
from trocar.procs.crtk.plain import plain
from trocar.procs.host.host import Host
from trocar.procs.kinematics.poses import matrix_from_pose, pose_from_matrix

HZ: Final = 200
"""Goals of a stream in a second."""
KEPT: Final = 300
"""Records of a ring; more than there are in CHUNK_NS."""
CHUNK_NS: Final = 250_000_000
"""Time between two looks for changes of fields."""
SETTLE_S: Final = 0.05
LIMIT_S: Final = 10.0
HOMED: Final = "ENABLED|HOMED|homed=1|busy=0"
CLOSE: Final = 3e-5
"""rad, m: the original's iteration for an ECM stops 4e-6 early."""
FIELDS: Final[dict[str, dict[str, str]]] = {
    "arm": {"desired_state": "desired_state", "trajectory_ratio": "trajectory_j/ratio",
            "trajectory_ratio_v": "trajectory_j/ratio_v", "trajectory_ratio_a": "trajectory_j/ratio_a"},
    "teleop": {"desired_state": "desired_state", "state": "current_state", "following": "following", "scale": "scale",
               "rotation_locked": "rotation_locked", "translation_locked": "translation_locked"},
    "console": {"teleop_enabled": "teleop_enabled"},
}
"""Fields of records whose changes are events of the original."""
VALUES: Final = ("goal_reached", "orientation_locked")
TEXTS: Final = ("tool_type", "endoscope_type")
MESSAGES: Final = ("status", "warning", "error")
KEEPS: Final = ("operating_state", "orientation_locked", *{name for each in FIELDS.values() for name in each.values()})
"""Events that tell a state: the same once more says nothing."""
INITIAL: Final = {"desired_state": "DISABLED", "current_state": "DISABLED", "following": "false", "scale": "0.200000",
                  "operating_state": "DISABLED|DISABLED|homed=0|busy=0", "orientation_locked": "false",
                  "rotation_locked": "false", "translation_locked": "false", "teleop_enabled": "false",
                  **{f"trajectory_j/ratio{end}": "1.000000" for end in ("", "_v", "_a")}}
"""What is known before the first event."""
_FIELD_NAMES: Final = {name for each in FIELDS.values() for name in each.values()}
Line = tuple[str, str, str]  # component, event, value
Rows = NDArray[Any]


class OriginalRobot:
    """A system of the stock share, hosted; and the steps of one of the original's runs, in order."""

    def __init__(self, run: Path, system: Path, share: Path) -> None:
        """`run`: the file of steps."""
        loaded = load_system(system, name=f"original{os.getpid()}{run.stem}", search=[share],
                             sets=["clock=lockstep", *AT_200_HZ])
        assert loaded.system is not None, loaded.errors
        self.run_name, self._steps = run.stem, iter(json.loads(run.read_text()))
        self.host = Host(loaded.system, KEPT)
        rows = [row for row in loaded.system.processes if row.kind in FIELDS]
        self._kinds = {row.name: row.kind for row in rows}
        self._clients = {each: self.host.client(each) for each in (*self._kinds, "system")}
        self._states = {each: self.host.reader(each) for each in self._kinds}
        self._events = {each: self.host.reader(each, "events") for each in self._kinds}
        self._seen: dict[tuple[str, str, str], str] = {}
        self._outcomes: dict[tuple[str, int], str] = {}
        self._heard: list[Line] = []
        self.differences: list[str] = []
        self._looked_ns = self.host.now_ns
        self.wait(0.1)
        self._listen()
        self._heard.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.host.close()

    # what is asked

    def ask(self, owner: str, command: str, values: Sequence[float] = (), text: str = "") -> None:
        """A command, until it is done."""
        number, end_ns = self.start(owner, command, values, text), self.host.now_ns + LIMIT_S * 1e9
        while self._outcomes.get((owner, number), "accepted") == "accepted" and self.host.now_ns < end_ns:
            self.wait(0.01)

    def start(self, owner: str, command: str, values: Sequence[float] = (), text: str = "", seconds: float = 0.0
              ) -> int:
        """A command, and this much time."""
        number = self._clients[owner].send(command, values, text)
        self.wait(seconds)
        return number

    def stream(self, owner: str, command: str, goal: Callable[[float], Sequence[float] | Rows], seconds: float) -> None:
        """Goals at times from 0 to `seconds`, which is left out."""
        for count in range(round(seconds * HZ)):
            self.start(owner, command, tuple(goal(count / HZ)), seconds=1 / HZ)

    def recover(self, arm: str) -> None:
        """Home an arm, unheard, as between two steps of the original."""
        for word in ("enable", "home"):
            self.ask(arm, "state_command", text=word)
        self.wait(SETTLE_S)
        self._listen()
        self._heard += [(arm, "desired_state", "HOMED"), (arm, "operating_state", HOMED)]
        for who in ("original", "trocar"):
            self._told(who, self._heard)
        self._heard.clear()

    def joints(self, arm: str) -> Rows:
        """Joint setpoint."""
        return self._field(arm, "setpoint_position")[: int(self._field(arm, "count"))]

    def pose(self, arm: str, name: str = "setpoint_cp") -> Rows:
        """Setpoint of the tip (4, 4)."""
        return matrix_from_pose(self._field(arm, name))

    def tip(self, arm: str, shift: Sequence[float] | Rows = (0.0, 0.0, 0.0), turn: Rows | None = None) -> Rows:
        """The setpoint of the tip as a goal (7,), shifted and turned in the axes of its frame."""
        goal = self.pose(arm)
        goal[:3, 3] += np.pad(np.asarray(shift, float), (0, 3 - len(shift)))
        if turn is not None:
            goal[:3, :3] = turn @ goal[:3, :3]
        return pose_from_matrix(goal)

    # what is seen

    @contextmanager
    def step(self, name: str, seconds: float = SETTLE_S) -> Iterator[None]:
        """The next step of the run, which has this name; commands in the block are its, then `seconds` pass."""
        original = next(self._steps)
        assert original["step"] == name
        yield
        self.wait(seconds)
        self._listen()
        self.differences += [f"{self.run_name}/{name} | {line}" for line in self._compared(original)]

    def ended(self) -> bool:
        """Whether all steps were played."""
        return next(self._steps, None) is None

    def _compared(self, original: dict[str, Any]) -> Iterator[str]:
        theirs = [(who, what, str(value)) for _, who, what, value in original["events"]]
        yield from _unlike(self._told("original", theirs), self._told("trocar", self._heard))
        self._heard = []
        arm = original["arm"]
        if arm is None:
            names = ("MTML", "MTMR", "ECM") if len(original.get("poses", ())) == 3 else ("MTMR", "PSM1", "MTML", "PSM2")
            for each, pose in zip(names, original.get("poses", ()), strict=False):
                yield from _off(f"{each} setpoint_cp", pose, self.pose(each))
            return
        if original["state"] != self._state(arm):
            yield f"state {self._state(arm)}, there {original['state']}"
        for key, valid, ours in (("setpoint_jp", "valid", self.joints(arm)),
                                 ("setpoint_cp", "reference_valid", self.pose(arm)),
                                 ("local_setpoint_cp", "cartesian_valid", self.pose(arm, "local_setpoint_cp")),
                                 ("jaw", "has_jaw", self._field(arm, "jaw_setpoint_position").reshape(1))):
            if key in original and not self._field(arm, valid):
                yield f"{key} not valid"
            elif key in original:
                yield from _off(key, original[key], ours)

    def _told(self, who: str, lines: Sequence[Line]) -> dict[str, list[str]]:
        """Events of each component by kind: those that tell something new, messages without their text."""
        told: dict[str, list[str]] = defaultdict(list)
        for component, event, value in lines:
            if event in KEEPS:
                key = who, component, event
                if self._seen.get(key, INITIAL.get(event)) == value:
                    continue
                self._seen[key] = value
            if event in MESSAGES:
                told[f"{component} messages"].append(_worded(event, value, who))
            else:
                own = event if event in _FIELD_NAMES else "events"
                told[f"{component} {own}"].append(f"{event} {value}".rstrip())
        return told

    def _listen(self) -> None:
        self._look()
        for name, ring in self._events.items():
            while ring.next():
                row = {each: plain(ring.field(each).item()) for each in ("event", "component", "value", "text", "state",
                       "sub_state", "is_homed", "is_busy")}
                self._heard += self._line(name, row)

    def _line(self, name: str, row: dict[str, Any]) -> Iterator[Line]:
        event = row["event"]
        if event == "operating_state":
            yield name, event, f"{row['state']}|{row['sub_state']}|homed={row['is_homed']:d}|busy={row['is_busy']:d}"
        elif event in VALUES:
            yield name, event, _word(bool(row["value"]))
        elif event in TEXTS + MESSAGES:
            yield name, event, row["text"]

    def wait(self, seconds: float) -> None:
        """Let time pass, and look at everything."""
        end_ns = self.host.now_ns + round(seconds * 1e9)
        while self.host.now_ns < end_ns:
            self.host.run_until(min(end_ns, self._looked_ns + CHUNK_NS))
            if self.host.now_ns - self._looked_ns >= CHUNK_NS:
                self._look()
        for owner, client in self._clients.items():
            self._outcomes |= {(owner, reply.id): reply.outcome for reply in client.poll()}

    def _look(self) -> None:
        since_ns, self._looked_ns = self._looked_ns, self.host.now_ns
        for name, ring in self._states.items():
            rows = ring.since(since_ns)
            for field, event in FIELDS[self._kinds[name]].items():
                column = rows[field]
                for at in [*range(min(1, len(column))), *(np.flatnonzero(column[1:] != column[:-1]) + 1)]:
                    self._heard.append((name, event, _word(plain(column[at].item()))))

    def _state(self, arm: str) -> str:
        words = {each: plain(self._field(arm, each).item()) for each in ("state", "sub_state", "is_homed", "is_busy")}
        return f"{words['state']}|{words['sub_state']}|homed={words['is_homed']:d}|busy={words['is_busy']:d}"

    def _field(self, name: str, field: str) -> Rows:
        ring = self._states[name]
        assert ring.newest()
        return ring.field(field).copy()


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:.6f}" if isinstance(value, float) else str(value)


def _worded(event: str, text: str, who: str) -> str:
    """A message: its kind only; of those of the original that are of one kind also which."""
    same = re.fullmatch(r"\w+: (control|desired state|effort cartesian) .*", text)
    return f"{event} ({same[1]})" if same and who == "original" else event


def _unlike(theirs: dict[str, list[str]], ours: dict[str, list[str]]) -> Iterator[str]:
    for group in sorted({*theirs, *ours}):
        for line in difflib.ndiff(theirs.get(group, []), ours.get(group, [])):
            if line[0] in "-+":
                yield f"{group} {line}"


def _off(what: str, theirs: Any, ours: Rows) -> Iterator[str]:
    there = np.asarray(theirs, float)
    if there.shape != ours.shape:
        yield f"{what} has {ours.shape}, there {there.shape}"
    elif not np.allclose(there, ours, rtol=0.0, atol=CLOSE):
        off = float(np.abs(there - ours).max())
        yield f"{what} off by {off:.1e}" if math.isfinite(off) else f"{what} off by {off}"
