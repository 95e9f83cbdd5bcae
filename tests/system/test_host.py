"""What a host computes is what processes in lock-step do: every record of an arm, bit by bit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from procs.document.system import from_json
from procs.host.host import Host
from shm import directory
from shm.client import Client
from tests.system.robot import DEMO, Robot, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
TELEOP = DEMO.parent / "kinematic-teleop.yaml"
SECOND_NS = 1_000_000_000


@pytest.mark.parametrize(("file", "options"), [(DEMO, ("--boards", "emulated")), (TELEOP, ())],
                         ids=["boards", "teleop"])
def test_a_host_does_bit_by_bit_what_processes_do(robot: Robot, file: object, options: tuple[str, ...]) -> None:
    robot.up(file, *options, "--clock", "lockstep")  # type: ignore[arg-type]
    ring, audit = directory.reader(robot.name, "PSM1", "state"), directory.reader(robot.name, "PSM1", "audit")
    document = from_json(directory.document(robot.name))
    client, rows, outcomes = Client(robot.name, "PSM1"), list[bytes](), dict[int, str]()

    def is_done(number: int) -> bool:
        while ring.next():
            rows.append(bytes(ring.record))
        outcomes.update({reply.id: reply.outcome for reply in client.poll()})
        return outcomes.get(number) == "done"

    for word in ("enable", "home"):
        number = client.send("state_command", (), word)
        wait_for(lambda number=number: is_done(number), 60.0, word)  # type: ignore[misc]
    given = [(int(row["stamp_ns"]), row["text"].decode()) for row in audit.last(9) if row["outcome"] == b"accepted"]
    client.close()
    is_done(0)
    lost, dtype = ring.lost, ring.dtype
    ring.close()
    audit.close()
    assert robot.down() == 0

    theirs = np.frombuffer(b"".join(rows), dtype)
    ours = hosted(dataclasses.replace(document, name=f"{robot.name}h"), given, int(theirs["stamp_ns"][-1]))
    assert not lost and len(theirs) > 1500
    _, mine, processes = np.intersect1d(ours["stamp_ns"], theirs["stamp_ns"], return_indices=True)
    assert len(processes) == len(theirs)
    for name in dtype.names or ():
        assert ours[name][mine].tobytes() == theirs[name][processes].tobytes(), name


def hosted(document: object, given: list[tuple[int, str]], end_ns: int) -> np.ndarray:  # type: ignore[type-arg]
    """All records of the arm in a host, where commands come in the cycles in which they came to the process."""
    rows = []
    with Host(document, history=4096) as host:  # type: ignore[arg-type]
        ring, client = host.reader("PSM1"), host.client("PSM1")
        for stamp_ns, word in [*given, (end_ns + 1, "")]:
            while host.now_ns < stamp_ns - 1:
                host.run_until(min(stamp_ns - 1, host.now_ns + SECOND_NS))
                while ring.next():
                    rows.append(bytes(ring.record))
            if word:
                client.send("state_command", (), word)
        return np.frombuffer(b"".join(rows), ring.dtype)
