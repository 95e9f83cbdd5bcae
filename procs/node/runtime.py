"""The life of every process, ours, a user's or a bridge: start, pacing, stalls and end. Its work is a `Loop`:

    class ArmLoop(runtime.Loop):
        def setup(self): ...
        def update(self): ...
        def quit(self): ...
    def main():
        runtime.run("arm", ArmLoop)
"""

from __future__ import annotations

import faulthandler
import gc
import logging
import signal
import sys
from collections.abc import Callable

from trocar.procs.node.life import arguments, document_of, lived
from trocar.procs.node.node import Node
from trocar.procs.node.realtime import step_back
from trocar.procs.node.setup_error import SETUP_FAILED
from trocar.procs.tables.manifest import proc, rest_periods
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.memory.segment import SegmentError


class Loop:
    """The work of a process: `setup`, an `update` each period, `quit`; after a stall, all of it by a new object."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.rest_periods = rest_periods(node.row)
        """Periods of a cycle in which it has nothing to do."""

    # to override

    def setup(self) -> None:
        """Open rings, mailboxes and other resources, most of them through `node`, which closes them after `quit`."""

    def update(self) -> None:
        """Do the work of one period: receive, decide, act, publish."""

    def quit(self) -> None:
        """Close what `setup` opened and `node` does not hold; called in all cases except kill -9."""

    @property
    def may_rest(self) -> bool:
        """Whether its next cycle may be as late as `rest_periods`, unless it `has_news`."""
        return False

    def has_news(self) -> bool:
        """Whether there is a reason to begin a cycle early."""
        return False

    def tick(self) -> bool:
        """End this period and wait for the next one; False when the process must end."""
        if self.may_rest:
            return self.node.tick(news=self.has_news, periods=self.rest_periods)
        return self.node.tick()

    # start and end

    def main(self) -> None:
        """Work until `tick` returns False; by default, call `update` once a period, until it restarts after a stall."""
        node, restarts = self.node, proc(self.node.kind).pause_ends
        while self.tick() and not (node.held_up_ns and restarts):
            self.update()

    def begin(self) -> None:
        """Call `setup`, and show the process as running."""
        self.setup()
        self.node.ready()

    def run(self) -> None:
        """Call `setup`, `main` and `quit`; quit also after an error in the first two, which is passed on."""
        try:
            self.begin()
            self.main()
        finally:
            self.quit()


def run(kind: str, make: Callable[[Node], Loop], *, traces: bool = False) -> None:
    """Run one process of this kind, from start to exit. Exit code 0: ended on request or by itself, 3: setup failed,
    4: `main` failed. `traces`: see `lived`.
    """
    chosen, row = arguments(kind), proc(kind)
    faulthandler.enable()  # its log shows where C code crashes
    faulthandler.register(signal.SIGUSR1, file=2, all_threads=False)  # and where it hangs, see supervisor
    if row.declared:
        ACTING.confine(chosen.system)  # no operator has started it: it acts only on operators' commands to its system
    try:
        node = Node(document_of(chosen.system), chosen.name)
    except (SegmentError, KeyError, ValueError) as error:
        logging.getLogger(chosen.name).error("%s", error)
        sys.exit(SETUP_FAILED)
    with lived(node, traces):
        node.ask()
        node.steps_back = node.row.priority > 0 and not row.reserved
        if node.steps_back:
            step_back()
        node.locks = row.realtime and not node.simulated
        if row.realtime:
            gc.collect()
            gc.freeze()
            gc.disable()
        live(node, make)
    if row.realtime:
        gc.unfreeze()  # otherwise extension modules report leaks at exit
        gc.enable()
    node.close()


def live(node: Node, make: Callable[[Node], Loop]) -> None:
    """Run loops until the process ends: after each stall a new one, as if the process had been started again."""
    _run_one(node, make)
    while node.held_up_ns and not node.stop_reason:
        node.begin_anew()
        gc.collect()  # collects the old loop; older objects are frozen
        _run_one(node, make)


def _run_one(node: Node, make: Callable[[Node], Loop]) -> None:
    try:
        make(node).run()
    finally:
        node.give_back()
