"""Setup joints on plain memory: a record, a clock, carried arms and events that a test writes and reads."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests import stock
from tests.io.harness import FakeCommand
from trocar.procs.config import load_system
from trocar.procs.document.system import Cart, SystemConfig
from trocar.procs.kinematics import poses
from trocar.procs.node.inputs import SETUP_LATE_S, Input
from trocar.procs.suj.frames import CarriedTip
from trocar.procs.suj.joints import SetupContext, SetupJoints
from trocar.procs.suj.setups import Setups
from trocar.procs.tables.code_row import ERROR, Code
from trocar.shm.memory.layout import schema_of
from trocar.shm.system.events import SEVERITIES
from trocar.shm.topics import ARM_STATE, SUJ_SETPOINT, SUJ_STATE, Topic

MS = 1_000_000
HEAD = '{"$id": "dvrk-system.schema.json", "$version": "1", '


def system_of(tmp_path, arms: str, ios: str = "", *, boards: str | None = None,
              folder: str = "dvrk-share") -> SystemConfig:
    """A system of these arms, whose files are the stock ones."""
    file = tmp_path / "system.json"
    file.write_text(f'{HEAD}{ios}"arms": [{arms}]}}')
    loaded = load_system(file, search=[stock.find(folder), stock.find("dvrk-share")], boards=boards)
    assert loaded.system is not None, loaded.errors
    return loaded.system


class FakeMemory:
    """One record, as a ring's private one."""

    def __init__(self, topic: Topic, **dims: int) -> None:
        self._record: Any = np.zeros(1, dtype=schema_of(topic, dims).dtype)

    def field(self, name: str) -> Any:
        return self._record[name].reshape(self._record[name].shape[1:])


class FakeRing(FakeMemory):
    """The record of a carried arm, always whole."""

    epoch = 1

    def __init__(self) -> None:
        super().__init__(ARM_STATE)
        self.stamp_ns = 0

    def newest(self) -> bool:
        return self.stamp_ns > 0

    def write(self, now_ns: int, tip: np.ndarray, valid: bool = True) -> None:
        self.stamp_ns = now_ns
        self.field("local_measured_cp")[...], self.field("cartesian_valid")[...] = poses.pose_from_matrix(tip), valid


class FakeSetupReports:
    """Remembers what is reported."""

    def __init__(self) -> None:
        self.reported: list[tuple[str, str, str]] = []
        self.faults: list[tuple[str, int, int, float, float]] = []
        self.states: list[tuple[str, str, bool, bool]] = []

    def status(self, text: str, component: str = "") -> None:
        self.reported.append(("status", "", text))

    def report(self, code: Code, text: str, component: str = "", axis: int = -1, value: float = 0.0,
               limit: float = 0.0, board: int = -1) -> None:
        self.reported.append((SEVERITIES[code.severity], code.code, text))
        if code.severity >= ERROR:
            self.faults.append((code.code, axis, board, value, limit))

    def operating_state(self, state: str, sub_state: str, is_homed: bool, is_busy: bool) -> None:
        self.states.append((state, sub_state, is_homed, is_busy))

    def of(self, kind: str) -> list[str]:
        return [text for reported, _, text in self.reported if reported == kind]


class SetupHarness:
    """A cart; `source` makes what measures it of (cart, setups, reports, field, setpoint)."""

    def __init__(self, cart: Cart, source=None, memory: FakeMemory | None = None, on_behalf=None) -> None:
        """`on_behalf` is told whose commands are carried out."""
        self.cart = cart
        self.memory = memory or FakeMemory(SUJ_STATE, setups=len(cart.arms))
        self.setpoint = FakeMemory(SUJ_SETPOINT)
        self.reports = FakeSetupReports()
        self.now_ns = 1_000 * MS
        setups = Setups(cart, self.memory.field)
        self.rings = {arm.name: FakeRing() for arm in cart.arms if arm.carries}
        tips = [CarriedTip(arm.carries, Input(self.rings[arm.name], SETUP_LATE_S)) if arm.carries else None
                for arm in cart.arms]
        made = source(cart, setups, self.reports, self.memory.field, self.setpoint.field) if source else None
        self.source = made
        self.joints = SetupJoints(cart, setups, made, SetupContext(
            self.memory.field, self.reports, tips, on_behalf=on_behalf or (lambda origin: None)))

    def tips(self, **of: np.ndarray) -> None:
        """These carried arms show their tips here, from now on in every step."""
        for name, tip in of.items():
            self.rings[name].write(self.now_ns, tip)

    def step(self, *requests: FakeCommand, ms: float = 2.0) -> None:
        self.now_ns += round(ms * MS)
        for ring in self.rings.values():
            if ring.stamp_ns:
                ring.stamp_ns = self.now_ns
        self.joints.step(self.now_ns, requests)

    def ask(self, name: str, text: str = "", *values: float) -> FakeCommand:
        request = FakeCommand(name, text, *values)
        self.step(request)
        return request

    def field(self, name: str) -> Any:
        return self.memory.field(name)

    def row(self, name: str) -> int:
        return [arm.name for arm in self.cart.arms].index(name)

    def base(self, name: str) -> tuple[np.ndarray, bool, str]:
        """Base frame (4, 4), whether it is valid, and its frame."""
        row = self.row(name)
        return (poses.matrix_from_pose(self.field("measured_cp")[row]), bool(self.field("base_valid")[row]),
                self.field("reference_frame")[row].decode())
