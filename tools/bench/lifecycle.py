"""`trocar bench lifecycle`: start and stop times of processes.

A PSM on emulated boards, and beside it a process that runs on demand. `up_s` is until every process has passed its
setup, `up_to_homed_s` until the arm is homed as well; both count from before the supervisor is started. Medians of some
tries: `first_subscription_to_running_s` is from a subscription to the first record of the process started for it,
`last_left_to_stopped_s` from the end of the subscription until the process has ended (without lingering); `restart_s`
is the arm's. `down_s` is from homed, powered, to complete removal. `full_up_s` and `full_down_s` are those of the full
KINEMATIC robot, and `full_pss_mb` is its memory, with shared parts counted once. All seconds are of real time; the
systems' own are paced.
"""

from __future__ import annotations

import json
import os
from contextlib import closing
from functools import partial
from typing import Any, Final

import psutil

from trocar.procs.tables.bring_up import HOMED
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.tools.bench.beside import ask
from trocar.tools.bench.measuring import FULL, medians, pss_mb, seconds_since, wait_until
from trocar.tools.client.bring_up import bring_all
from trocar.tools.client.remote import Remote
from trocar.tools.systems.cleanup import own_folder
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

ARM, PROCESS, TOPIC, TRIES = "PSM1", "counter", "count", 5
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
    """Measure."""
    name = f"bench-lifecycle-{os.getpid()}"
    with own_folder(name) as folder:
        file = folder / "system.json"
        file.write_text(json.dumps(SYSTEM))
        (folder / f"{PROCESS}.py").write_text(COUNTER)
        begin = monotonic_ns()
        with up_meanwhile(StartRequest(file, name, "emulated")):
            up_s = seconds_since(begin)
            bring_all(name, (), HOMED)
            figures = {"up_s": up_s, "up_to_homed_s": seconds_since(begin)}
            figures |= medians(TRIES, partial(_on_demand, name)) | medians(TRIES, partial(_restart, name))
            begin = monotonic_ns()
        figures["down_s"] = seconds_since(begin)
    figures |= _full_robot(f"{name}-full")
    return {"figures": figures, "conditions": {"tries": TRIES}}


def _full_robot(system: str) -> dict[str, float]:
    """Start and stop it, nothing moves."""
    begin = monotonic_ns()
    with up_meanwhile(StartRequest(FULL, system)) as background:
        up_s = seconds_since(begin)
        memory_mb = pss_mb(background.popen.pid)
        begin = monotonic_ns()
    return {"full_up_s": up_s, "full_down_s": seconds_since(begin), "full_pss_mb": memory_mb}


def _on_demand(system: str) -> dict[str, float]:
    """Subscribe and leave."""
    with closing(ControlPage(system, PROCESS)) as page, closing(directory.reader(system, PROCESS, TOPIC)) as reader:
        before, begin = reader.head, monotonic_ns()
        with closing(Subscriber(system, PROCESS)) as subscriber:
            subscriber.want(TOPIC)
            wait_until(lambda: reader.head > before, f"{PROCESS} publishes")
            came_s, pid = seconds_since(begin), int(page.get("pid"))
        begin = monotonic_ns()
        wait_until(lambda: not psutil.pid_exists(pid), f"{PROCESS} has ended")
    return {"first_subscription_to_running_s": came_s, "last_left_to_stopped_s": seconds_since(begin)}


def _restart(system: str) -> dict[str, float]:
    """Restart the arm, which resumes from shared memory."""
    with Remote(system, "supervisor") as remote:
        begin = monotonic_ns()
        ask(remote, "restart", ARM)
        return {"restart_s": seconds_since(begin)}
