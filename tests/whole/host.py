"""A whole KINEMATIC system in this process: the loops of its processes, one after the other, on a stepped clock."""

from __future__ import annotations

from collections.abc import Collection
from types import TracebackType
from typing import Any, Self

from procs import runtime
from procs.arm import loop as arm_loop
from procs.config import PROJECT_CONFIGS, load_system
from procs.console import loop as console_loop
from procs.io import loop as io_loop
from procs.suj import loop as suj_loop
from procs.supervisor import memory
from procs.system import loop as system_loop
from procs.teleop import loop as teleop_loop
from shm.lockstep import Timekeeper

LOOPS = {"io": io_loop.IoLoop, "arm": arm_loop.ArmLoop, "teleop": teleop_loop.TeleopLoop,
         "console": console_loop.ConsoleLoop,
         "suj": suj_loop.SetupLoop, "system": system_loop.SystemLoop}
STEP_NS = 5_000_000


class WholeHost:
    """The system of a file of ours; a context manager. `loops` by instance."""

    def __init__(self, name: str, file: str = "kinematic-teleop") -> None:
        loaded = load_system(PROJECT_CONFIGS / "systems" / f"{file}.yaml", name=name, sets=["clock=lockstep"])
        assert loaded.system is not None, loaded.errors
        self.name, self.document = name, loaded.system
        memory.create_all(loaded.system)
        self._clock = Timekeeper(name, memory.simulated(loaded.system))
        self.node = {row.name: runtime.Node(row.kind, name, row.name) for row in loaded.system.processes}
        self.loops = {name: LOOPS[node.kind](node) for name, node in self.node.items()}

    def restart(self, instance: str, *, killed: bool = False) -> None:
        """The loop of an instance anew, as a process that was started again begins; `killed`: it left nothing in order.
        """
        node = self.node[instance]
        if not killed:
            self.loops[instance].close()
        node.give_back()
        self.loops[instance] = LOOPS[node.kind](node)
        assert node._mailbox is not None
        node._mailbox.refuse_waiting("it was started again")

    def step(self, but: Collection[str] = ()) -> None:
        """One cycle of everybody, `but` of those that are late."""
        now_ns = self._clock.now_ns() + STEP_NS
        self._clock._go(now_ns)
        for name, loop in self.loops.items():
            if name in but:
                continue
            self.node[name].now_ns = now_ns
            loop.cycle(now_ns, 0)

    def run(self, seconds: float) -> None:
        """So long."""
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.step()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 where: TracebackType | None) -> None:
        for name, loop in self.loops.items():
            loop.close()
            node: Any = self.node[name]
            node.leave()
            node.clock.close()
        self._clock.close()
        memory.remove_all(self.name)
