"""`trocar bench bridges`: what bridges to ROS and to sockets cost, and how soon a command of a socket is carried out.

The full KINEMATIC system on the wall clock, homed. `ros_cpu_percent_unsubscribed` is the ROS bridge while nobody reads,
`ros_cpu_percent_30_topics` while a client in this process reads 30 topics, 100 times a second each (100 % is one core);
`ros_messages_per_s` came here. `socket_command_ms_p50` is from sending `hold` over TCP to hearing that it is done.
`io_period_p99_ratio` is io's period (99 %) with both bridges at work to that without, median of pairs by turns.
"""

from __future__ import annotations

import json
import os
import platform
import socket
import statistics
from contextlib import closing
from typing import Any, Final

import psutil

from trocar.procs.ros_messages.dds import Participant, TopicReader
from trocar.procs.ros_messages.messages import JointStates, PoseStamped, TwistStamped
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.bench.beside import ARMS, PAIRS, PATIENCE_S, TAKE_S, ask, period_p99
from trocar.tools.bench.cpu_time import cpu_s
from trocar.tools.bench.system import FULL, home_all
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Problem
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

BRIDGE: Final = "ros_bridge"
TOPICS: Final[tuple[tuple[str, Any], ...]] = (
    ("measured_js", JointStates), ("setpoint_js", JointStates), ("measured_cp", PoseStamped),
    ("setpoint_cp", PoseStamped), ("measured_cv", TwistStamped))
COMMANDS: Final = 300
SETTLE_S: Final = 2.0


def run(seconds: float = 30.0, pairs: int = PAIRS) -> dict[str, Any]:
    """Measure; returns the object that `--json` prints. `seconds`: of each part of a pair."""
    name, port = f"bench-bridges-{os.getpid()}", _free_port()
    domain = 1 + os.getpid() % 230
    sets = ("clock=wall", f"ros.domain={domain}", f"socket.listen=127.0.0.1:{port}")
    with up_meanwhile(StartRequest(FULL, name, sets=sets)):
        home_all(name)
        with closing(Participant(domain, name="bench")) as participant:
            figures = {"ros_cpu_percent_unsubscribed": _cpu_percent(name, [], min(seconds, 10.0))[0]}
            readers: list[TopicReader[Any]] = [participant.reader(f"{arm}/{topic}", message, 100)
                                               for arm in ARMS for topic, message in TOPICS]
            _settle(name, readers)
            figures["ros_cpu_percent_30_topics"], figures["ros_messages_per_s"] = _cpu_percent(
                name, readers, min(seconds, 10.0))
            figures["socket_command_ms_p50"] = _command_ms(port)
            figures["io_period_p99_ratio"] = _ratio(name, readers, seconds, pairs)
    return {
        "bench": "bridges", "figures": figures,
        "conditions": {"topics": len(readers), "seconds": seconds, "pairs": pairs, "commands": COMMANDS,
                       "cores": len(psutil.Process().cpu_affinity() or []), "load": os.getloadavg()[0],
                       "kernel": platform.release(), "python": platform.python_version()},
    }


def _settle(system: str, readers: list[TopicReader[Any]]) -> None:
    """Until something of every topic has come, and a while longer; Problem where nothing comes."""
    missing, end = readers, monotonic_ns() + round(PATIENCE_S * 1e9)
    while missing := [reader for reader in missing if not reader.take()]:
        if monotonic_ns() > end:
            raise Problem("the ROS bridge has sent nothing")
        pause(TAKE_S)
    _cpu_percent(system, readers, SETTLE_S)


def _cpu_percent(system: str, readers: list[TopicReader[Any]], seconds: float) -> tuple[float, float]:
    """CPU time of the ROS bridge in a while in which we read; and messages a second."""
    with closing(ControlPage(system, BRIDGE)) as page:
        pid = int(page.get("pid"))
    before, begin, count = cpu_s(pid), monotonic_ns(), 0
    while (passed_s := (monotonic_ns() - begin) * 1e-9) < seconds:
        pause(TAKE_S)
        count += sum(len(reader.take()) for reader in readers)
    return (cpu_s(pid) - before) / passed_s * 100.0, count / passed_s


def _command_ms(port: int) -> float:
    """Median of so many commands, one after the other."""
    took = []
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection, connection.makefile("rw") as stream:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for number in range(1, COMMANDS + 1):
            begin = monotonic_ns()
            stream.write(json.dumps({"op": "call", "id": number, "to": "PSM1", "command": "hold"}) + "\n")
            stream.flush()
            while (heard := json.loads(stream.readline())).get("outcome") != "done":
                if heard["op"] == "error" or heard.get("outcome") in ("refused", "failed"):
                    raise Problem(f"the socket bridge says: {heard}")
            took.append((monotonic_ns() - begin) * 1e-6)
    return statistics.median(took)


def _ratio(system: str, readers: list[TopicReader[Any]], seconds: float, pairs: int) -> float:
    ratios = []
    with Remote(system, "supervisor") as remote:
        for _ in range(pairs):
            with_bridges = period_p99(system, seconds, lambda: [reader.take() for reader in readers])
            ask(remote, "stop", BRIDGE)
            ratios.append(with_bridges / period_p99(system, seconds, lambda: None))
            ask(remote, "start", BRIDGE)
            _settle(system, readers)
    return statistics.median(ratios)


def _free_port() -> int:
    with closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
