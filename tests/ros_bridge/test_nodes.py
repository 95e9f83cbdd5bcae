"""Names of the nodes that send, as far as their processes announce them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from uuid import UUID

import pytest

from trocar.procs.ros_messages.messages import Gid, NodeEntitiesInfo, ParticipantEntitiesInfo
from trocar.procs.ros_messages.nodes import NodeNames

KEY = UUID(int=7)


def names(*announced: str) -> NodeNames:
    """After a process has announced these nodes."""
    info = ParticipantEntitiesInfo(Gid(KEY.bytes), [NodeEntitiesInfo("/", name) for name in announced])
    participant: Any = SimpleNamespace(read_as=lambda *_, **__: SimpleNamespace(take=lambda: [info]))
    found = NodeNames(participant)
    found.look()
    return found


@pytest.mark.parametrize(("announced", "name"), [
    (("crtk_teleop",), "crtk_teleop"), (("first", "second"), "first"), ((), ""), (("a\nb", "c"), "c"),
    (("x" * 500,), "x" * 64)])
def test_a_process_has_the_name_of_its_first_node(announced: tuple[str, ...], name: str) -> None:
    assert names(*announced).of(KEY) == name
    assert names(*announced).of(UUID(int=8)) == ""
