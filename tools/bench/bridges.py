"""`trocar bench bridges`: cost of the ROS and socket bridges, and latency of a socket command.

The full KINEMATIC system on the wall clock, homed. `ros_cpu_percent_unsubscribed` is the ROS bridge without readers,
`ros_cpu_percent_30_topics` while a client in this process reads 30 topics, 100 times a second each (100 % is one core);
`ros_messages_per_s` are received here. `socket_command_ms_p50` is from sending `hold` over TCP to its final reply.
`io_period_p99_ratio` is io's period (99 %) with both bridges at work to that without, median of pairs by turns.
"""

from __future__ import annotations

import json
import os
import socket
import statistics
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any, Final

from trocar.procs.machine.free_port import reserved_port
from trocar.procs.ros_messages.dds import Participant, TopicReader
from trocar.procs.ros_messages.messages import JointStates, PoseStamped, TwistStamped
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.bench.beside import ARMS, PAIRS, RobotAtWork, full_robot
from trocar.tools.bench.measuring import PATIENCE_S, seconds_since, wait_until
from trocar.tools.output.errors import Problem

BRIDGE: Final = "ros_bridge"
TOPICS: Final[tuple[tuple[str, Any], ...]] = (
    ("measured_js", JointStates), ("setpoint_js", JointStates), ("measured_cp", PoseStamped),
    ("setpoint_cp", PoseStamped), ("measured_cv", TwistStamped))
COMMANDS: Final = 300
SETTLE_S: Final = 2.0


class RosReaders:
    """Our readers of ROS topics, and the number of received messages."""

    def __init__(self) -> None:
        self.readers: list[TopicReader[Any]] = []
        self.count = 0

    def take(self) -> None:
        """Read all available messages."""
        self.count += sum(len(reader.take()) for reader in self.readers)

    @contextmanager
    def all_read(self) -> Iterator[None]:
        """Begin when a message of every topic has arrived; Problem if one has none."""
        missing = list(self.readers)

        def have_come() -> bool:
            missing[:] = [reader for reader in missing if not reader.take()]
            return not missing

        wait_until(have_come, "a message of every topic from the ROS bridge")
        yield


def run(seconds: float = 30.0, pairs: int = PAIRS) -> dict[str, Any]:
    """Measure. `seconds`: of each part of a pair."""
    name, domain, short_s, ros = f"bench-bridges-{os.getpid()}", 1 + os.getpid() % 230, min(seconds, 10.0), RosReaders()
    robot = RobotAtWork(name, ros.take)
    with (reserved_port(18180) as port,
          full_robot(name, f"ros.domain={domain}", f"socket.listen=127.0.0.1:{port}"),
          closing(Participant(domain, name="bench")) as participant):
        figures = {"ros_cpu_percent_unsubscribed": robot.cpu_percent(short_s, robot.process(BRIDGE))}
        ros.readers = [participant.reader(f"{arm}/{topic}", message, 100) for arm in ARMS for topic, message in TOPICS]
        with ros.all_read():
            robot.wait(SETTLE_S)
            before, begin = ros.count, monotonic_ns()
            figures["ros_cpu_percent_30_topics"] = robot.cpu_percent(short_s, robot.process(BRIDGE))
            figures["ros_messages_per_s"] = (ros.count - before) / seconds_since(begin)
        figures["socket_command_ms_p50"] = _command_ms(port)
        figures["io_period_p99_ratio"] = robot.period_ratio(BRIDGE, seconds, pairs, ros.all_read, SETTLE_S)
    return {"figures": figures, "conditions": {"topics": len(ros.readers), "seconds": seconds, "pairs": pairs,
                                               "commands": COMMANDS}}


def _command_ms(port: int) -> float:
    """Median of this many commands, one after the other."""
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
