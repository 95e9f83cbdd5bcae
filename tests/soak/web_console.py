"""Whether the web console stays as large as it is, while pages are open and others come and go.

    python -m tests.soak.web_console --minutes 120

The full KINEMATIC system, all arms moving. A page System, a page 3D, one with plots and a log stay open; every two
seconds somebody loads a page, takes control, asks for a preview, jogs an arm, is refused something, and leaves. Prints
what the processes had at first and in the end; exit code 1 when something grew. The pages are scripted: no browser is
needed.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
import urllib.request
from contextlib import ExitStack, closing, suppress
from typing import Final

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.soak.flat import Footprint
from trocar.procs.machine.free_port import reserved_port
from trocar.procs.tables.bring_up import HOMED
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.bench.beside import MovingArms
from trocar.tools.bench.gui import SCENE_PAGE, SYSTEM_PAGE, ScriptedPage
from trocar.tools.bench.measuring import FULL
from trocar.tools.client.bring_up import bring_all
from trocar.tools.inspect.processes import statuses
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

EVERY_S: Final = 2.0
"""Between two visits, however long they take: pages that nobody connected to are kept for a minute, about 1 MB each."""
WATCHED: Final = "gui", "PSM1", "io", "system"
GROWTH_KB: Final = 4096
"""Of memory that is no leak: an allocator takes pieces of 1.3 MB at a time, and pages are of different size."""
STAYS: Final = (SYSTEM_PAGE, SCENE_PAGE, ("plot:PSM1/state.position[0]", "plot:io/state.position[0]", "log:gui",
                                          "processes", "buttons", "SUJ/state"))
PATHS: Final = "/", "/3d", "/arm/PSM1", "/console", "/teleop", "/suj", "/plots", "/processes", "/buttons", "/io"
ASKED: Final = (
    {"op": "control", "take": True, "over": True},
    {"op": "want", "sources": ["PSM1/state", "scene", "messages", "plot:ECM/state.position[0]"]},
    {"op": "preview", "id": 1, "arm": "PSM1", "pose": [0.0, 0.0, -0.11, 1.0, 0.0, 0.0, 0.0]},
    {"op": "jog", "id": 2, "arm": "PSM1", "twist": [0.001, 0.0, 0.0, 0.0, 0.0, 0.0]},
    {"op": "call", "id": 3, "to": "PSM2", "command": "no_such", "values": []},
    {"op": "nonsense"},
)
TICKS: Final = 5


def visit(port: int, path: str) -> None:
    """Load a page, be there for a moment, leave; whom a busy machine has held up disconnects all."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=30.0) as answer:
        answer.read()
    with suppress(ConnectionClosed), connect(f"ws://127.0.0.1:{port}/live", max_size=None, compression=None) as link:
        tick = 0
        for message in ASKED:
            link.send(json.dumps({**message, "tick": tick} if message["op"] in ("jog", "call") else message))
            while message["op"] == "want" and not tick:  # desired states go with the newest one that the page has heard
                heard = json.loads(link.recv(30.0))
                tick = heard["id"] if heard["op"] == "tick" else 0
        seen = 0
        while seen < TICKS:
            seen += '"tick"' in str(link.recv(30.0))[:20]


def soak(seconds: float) -> tuple[dict[str, Footprint], int]:
    """Footprints of the processes of `WATCHED`, and how many visits there were."""
    name, visits = f"soak-gui-{os.getpid()}", 0
    with reserved_port(18090) as port, up_meanwhile(StartRequest(FULL, name, sets=(
            f"gui.listen=127.0.0.1:{port}", "processes.gui.start=always"))), ExitStack() as stack:
        bring_all(name, (), HOMED)
        arms = stack.enter_context(closing(MovingArms(name)))
        for sources in STAYS:
            stack.enter_context(closing(ScriptedPage(port, sources)))
        found = {row.name: Footprint(row.pid) for row in statuses(name) if row.name in WATCHED}
        paths, begin = itertools.cycle(PATHS), monotonic_ns()
        while monotonic_ns() < begin + round(seconds * 1e9):
            visit(port, next(paths))
            visits += 1
            arms.go_on()
            for each in found.values():
                each.look()
            pause(max(0.0, EVERY_S * visits - (monotonic_ns() - begin) * 1e-9))
    return found, visits


def growth(found: dict[str, Footprint]) -> list[str]:
    """What grew, in words."""
    problems = []
    for name, each in found.items():
        memory_kb, files, threads = each.grown()
        if memory_kb > GROWTH_KB or files > 0 or threads > 0:
            way = each.memory_kb[:: max(1, len(each.memory_kb) // 20)]
            problems.append(f"{name} grew: {memory_kb:+.0f} kB, {files:+.0f} files, {threads:+.0f} threads: {way}")
    return problems


def main() -> None:
    """By hand."""
    parser = argparse.ArgumentParser(prog="tests.soak.web_console", description=__doc__)
    parser.add_argument("--minutes", type=float, default=120.0)
    minutes = parser.parse_args().minutes
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TROCAR_STATE"] = folder
        found, visits = soak(minutes * 60.0)
    for name, each in found.items():
        memory_kb, files, threads = each.grown()
        print(f"{name}: {each.memory_kb[0]} kB at first, {each.memory_kb[-1]} kB in the end, {memory_kb:+.0f} kB, "
              f"{files:+.0f} descriptors, {threads:+.0f} threads")
    print(f"{minutes:g} min, {visits} visits; load {os.getloadavg()[1]:.1f}")
    problems = growth(found)
    print("\n".join(problems) or "flat")
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
