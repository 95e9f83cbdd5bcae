"""A process's node without shared memory: rings are plain records, mailboxes and what the loop does with them a log."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from trocar.procs.node.inputs import Input
from trocar.procs.tables.manifest import LATE_S
from trocar.shm.mailbox.origins import Origin
from trocar.shm.memory.layout import schema_of
from trocar.shm.operator_topics import CONSOLE_STATE, TELEOP_STATE, THIRD_PARTY_STATE
from trocar.shm.topics import ARM_STATE, EVENTS, IO_STATE, SUJ_SETPOINT, SUJ_STATE

TOPICS = {("arm", "state"): ARM_STATE, ("io", "state"): IO_STATE, ("suj", "state"): SUJ_STATE,
          ("third_party", "state"): THIRD_PARTY_STATE, ("suj", "setpoint"): SUJ_SETPOINT,
          ("console", "state"): CONSOLE_STATE, ("teleop", "state"): TELEOP_STATE}
DIMS = {"axes": 8, "drives": 16, "robots": 4, "inputs": 64, "outputs": 32, "readers": 1, "setups": 4}


class StubRing:
    """One record; `publish` is noted."""

    def __init__(self, name: str, topic: Any, log: list[str], dims: dict[str, int]) -> None:
        self.name, self._log = name, log
        record: Any = np.zeros(1, dtype=schema_of(topic, dims).dtype)
        self._fields = {name: record[name].reshape(record[name].shape[1:]) for name in record.dtype.names}
        self.stamp_ns, self.epoch, self.lost, self.head, self.sequence = 0, 1, 0, 0, 0
        self.info = {"setups": ["ECM", "PSM1", "PSM2", "PSM3"]}

    def field(self, name: str) -> Any:
        return self._fields[name]

    def newest(self) -> bool:
        return self.stamp_ns > 0

    def next(self) -> bool:
        return False

    def publish(self, stamp_ns: int) -> None:
        self._log.append(f"publish {self.name} {stamp_ns}")


class StubClient:
    """A place in somebody's mailbox."""

    own_place = None

    def __init__(self, name: str, log: list[str]) -> None:
        self.name, self._log, self.answers = name, log, list[Any]()

    def on_behalf(self, origin: Origin) -> None:
        self._log.append(f"{self.name} for {origin.id}")

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        self._log.append(f"{self.name} < {name} {text} {tuple(float(value) for value in values)}")
        return 1

    def poll(self) -> list[Any]:
        found, self.answers = self.answers, []
        return found


class StubNode:
    """What loops use of `trocar.procs.node.Node`."""

    def __init__(self, document: Any, name: str) -> None:
        self.document, self.name, self.now_ns, self.wall_ns, self.stall = document, name, 0, 0, ""
        self.simulated = False
        self.row = document.process(name)
        self.subscriptions = SimpleNamespace(look=lambda: False, wanted=0)
        self.log: list[str] = []
        self.paced_by: list[str] = []
        self.clock = SimpleNamespace(now_ns=lambda: self.now_ns + 50_000)
        self.rings: dict[tuple[str, str], StubRing] = {}
        self.clients: dict[str, StubClient] = {}
        self.late_s: dict[str, float] = {}
        self.requests: list[Any] = []
        self.held: list[Any] = []
        self.has_mail = False
        log = self.log.append
        self.pacing = SimpleNamespace(latency=lambda latency_ns: log(f"latency {latency_ns}"))
        self.events = SimpleNamespace(
            status=lambda text, component="": log(f"status {text}"), emit=lambda event, text="", **rest: log(event),
            operating_state=lambda *rest: None, button=lambda *rest: None,
            report=lambda code, text, component="", *rest, **more: log(f"{code.code} {component}: {text}"))

    def hold(self, part: Any) -> Any:
        self.held.append(part)
        return part

    def kind(self, name: str) -> str:
        return next(row.kind for row in self.document.processes if row.name == name)

    def ring(self, name: str, topic: str) -> StubRing:
        what = EVENTS if topic == "events" else TOPICS[self.kind(name), topic]
        dims = {**DIMS, "teleops": len(self.document.consoles[0].teleops) if self.document.consoles else 0}
        return self.rings.setdefault((name, topic), StubRing(f"{name} {topic}", what, self.log, dims))

    def reads(self, name: str, topic: str, *, counts: bool = True) -> Any:
        return self.ring(name, topic)

    def writes(self, topic: str) -> Any:
        return self.ring(self.name, topic)

    def input(self, name: str, late_s: float = LATE_S) -> Input:
        self.late_s[name] = late_s
        return Input(self.ring(name, "state"))  # type: ignore[arg-type]

    def commands(self, name: str) -> Any:
        return self.clients.setdefault(name, StubClient(name, self.log))

    def faults(self) -> Any:
        return SimpleNamespace(words=[0, 0, 9], components=["PSM1"], cell=lambda name: (1, 2))

    def fault_cell(self) -> Any:
        return SimpleNamespace(void=0, spared=0, fault=lambda: self.log.append("fault"),
                               void_earlier=lambda origin: self.log.append(f"switched off by {origin}"))

    def mailbox(self, faults: Any) -> Any:
        self.voids = faults

        def drain(wall_ns: int) -> list[Any]:
            found, self.requests = self.requests, []
            return found

        return SimpleNamespace(drain=drain, has_news=self.has_mail)

    def tick(self, news: Callable[[], bool] | None = None, periods: int = 1) -> bool:
        self.log.append(f"tick {periods} {news() if news is not None else '-'}")
        return True

    def follows(self, name: str) -> None:
        self.paced_by.append(name)

    def follow(self, stamp_ns: int, lead_ns: int) -> None:
        self.log.append(f"follow {stamp_ns} {lead_ns}")
