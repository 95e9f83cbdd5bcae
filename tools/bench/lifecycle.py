"""`trocar bench lifecycle`: how long processes take to come and go.

A PSM on emulated boards, and beside it a process that runs on demand. `up_s` is until every process has passed its
setup, `up_to_homed_s` until the arm is homed as well; both count from before the supervisor is started. Medians of some
tries: `first_subscription_to_running_s` is from a subscription to the first record of the process that was started for
it, `last_left_to_stopped_s` from the end of that until there is no process (it does not linger); `restart_s` is the
arm's. `down_s` is from homed, powered, to nothing left. `full_up_s` and `full_down_s` are those of the full KINEMATIC
robot, and `full_pss_mb` is its memory, what processes share counted once. All seconds are of real time; the systems'
own are paced.
"""

from __future__ import annotations

import json
import os
import platform
import statistics
from collections.abc import Callable
from typing import Any, Final

import psutil

from trocar.procs.tables.bring_up import HOMED
from trocar.shm.commands import became
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.bench.system import FULL
from trocar.tools.client.bring_up import bring, silent
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import note
from trocar.tools.systems.cleanup import own_folder
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

ARM, PROCESS, TOPIC, TRIES, PATIENCE_S, POLL_S = "PSM1", "counter", "count", 5, 30.0, 0.001
COUNTER: Final = """
def main(process):
    while process.tick():
        process.publish("count", count=1)
"""
SYSTEM: Final = {
    "$id": "dvrk-system.schema.json", "$version": "1", "IOs": [{"name": "IO1", "port": "udp"}],
    "arms": [{"name": ARM, "type": "PSM", "serial": "demo", "IO": "IO1", "arm_file": "arms/PSM1-demo.yaml",
              "IO_file": "io/PSM1-demo.yaml", "PID_file": "pid/PSM.yaml"}],
    "trocar": {"boards": "emulated", "processes": [
        {"name": PROCESS, "module": f"{PROCESS}.py", "start": "on-demand", "linger_s": 0.0,
         "topics": [{"name": TOPIC, "fields": [{"name": "count", "type": "int"}]}]}]},
}


def run() -> dict[str, Any]:
    """Measure; returns the object that `--json` prints."""
    name = f"bench-lifecycle-{os.getpid()}"
    with own_folder(name) as folder:
        file = folder / "system.json"
        file.write_text(json.dumps(SYSTEM))
        (folder / f"{PROCESS}.py").write_text(COUNTER)
        begin = monotonic_ns()
        with up_meanwhile(StartRequest(file, name, "emulated")):
            up_s = _seconds(begin)
            if problem := bring(name, [ARM], HOMED, 0.0, silent, note)[ARM]:
                raise Problem(f"{ARM} is not homed: {problem}")
            figures = {"up_s": up_s, "up_to_homed_s": _seconds(begin), **_on_demand(name), "restart_s": _restarts(name)}
            begin = monotonic_ns()
        figures["down_s"] = _seconds(begin)
    figures |= _full_robot(f"{name}-full")
    return {
        "bench": "lifecycle", "figures": figures,
        "conditions": {"tries": TRIES, "cores": len(psutil.Process().cpu_affinity() or []), "load": os.getloadavg()[0],
                       "kernel": platform.release(), "python": platform.python_version()},
    }


def _full_robot(system: str) -> dict[str, float]:
    """Start and stop it, nothing moves."""
    begin = monotonic_ns()
    with up_meanwhile(StartRequest(FULL, system)) as background:
        up_s = _seconds(begin)
        supervisor = psutil.Process(background.popen.pid)
        pss = sum(each.memory_full_info().pss for each in (supervisor, *supervisor.children(recursive=True)))
        begin = monotonic_ns()
    return {"full_up_s": up_s, "full_down_s": _seconds(begin), "full_pss_mb": pss * 1e-6}


def _on_demand(system: str) -> dict[str, float]:
    """Subscribe and leave by turns."""
    came, left = [], []
    page, reader = ControlPage(system, PROCESS), directory.reader(system, PROCESS, TOPIC)
    try:
        for _ in range(TRIES):
            before, begin = reader.head, monotonic_ns()
            subscriber = Subscriber(system, PROCESS)
            try:
                subscriber.want(TOPIC)
                _wait(lambda before=before: reader.head > before, f"{PROCESS} publishes")  # type: ignore[misc]
                came.append(_seconds(begin))
                pid = int(page.get("pid"))
            finally:
                subscriber.close()
            begin = monotonic_ns()
            _wait(lambda pid=pid: not psutil.pid_exists(pid), f"{PROCESS} has ended")  # type: ignore[misc]
            left.append(_seconds(begin))
    finally:
        reader.close()
        page.close()
    return {"first_subscription_to_running_s": statistics.median(came),
            "last_left_to_stopped_s": statistics.median(left)}


def _restarts(system: str) -> float:
    """Restart the arm, which goes on from shared memory."""
    seen = []
    with Remote(system, "supervisor") as remote:
        for _ in range(TRIES):
            begin = monotonic_ns()
            reply = remote.settled("restart", text=ARM, timeout=PATIENCE_S)
            if reply.outcome != "done":
                raise Problem(f"restart of {ARM} {became(reply.outcome)}: {reply.text}")
            seen.append(_seconds(begin))
    return statistics.median(seen)


def _seconds(begin_ns: int) -> float:
    return (monotonic_ns() - begin_ns) * 1e-9


def _wait(done: Callable[[], bool], what: str) -> None:
    end = monotonic_ns() + round(PATIENCE_S * 1e9)
    while not done():
        if monotonic_ns() >= end:
            raise Problem(f"not within {PATIENCE_S:g} s: {what}")
        pause(POLL_S)
