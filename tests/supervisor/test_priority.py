"""Which priority the supervisor asks for."""

from __future__ import annotations

from trocar.procs.document.process import Process
from trocar.procs.supervisor.supervisor import highest_priority


def test_the_supervisor_has_the_priority_of_io_also_beside_emulated_boards() -> None:
    boards, io, arm = (Process(kind, kind, 0.001, priority=priority)
                       for kind, priority in (("boards", 90), ("io", 80), ("arm", 60)))
    assert highest_priority([boards, io, arm]) == highest_priority([io, arm]) == 80
    assert highest_priority([Process("user", "user", 0.01)]) == highest_priority([]) == 0
