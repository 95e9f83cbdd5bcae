"""Two users of one machine type the same commands at the same time."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator

import pytest

from tests.system.robot import ROOT
from tests.user_sim import UserSim

KINEMATIC = str(ROOT / "configs" / "systems" / "kinematic.yaml")
NUMBERS = (64101, 64102)  # without accounts
SMALL = ("--set", "recorder.on=false", "--set", "io.period_s=0.01", "--set", "arm.period_s=0.01", "--set", "gui={}")


@pytest.fixture
def users() -> Iterator[list[UserSim]]:
    if os.getuid() != 0:
        pytest.skip("only root can become another user")
    with UserSim.several(NUMBERS) as found:
        yield found


@pytest.mark.slow
@pytest.mark.patient
def test_each_user_has_a_system_of_their_own_without_a_word(users: list[UserSim]) -> None:
    starts = [user.start("up", KINEMATIC, "--detach", *SMALL) for user in users]
    outputs = [start.communicate(timeout=180.0)[0] for start in starts]
    assert [start.returncode for start in starts] == [0, 0], outputs
    shown = [user.status() for user in users]
    assert [one["system"] for one in shown] == [f"trocar-{number}" for number in NUMBERS]
    places = [row["listen"] for one in shown for row in one["processes"] if row["name"] == "gui"]
    assert len(places) == 2 and places[0] != places[1]
    assert all(f"http://{place[0]}" in output for place, output in zip(places, outputs, strict=True))

    code, output = users[1].types("up", KINEMATIC, "--system", shown[0]["system"], "--for", "1")
    assert code == 1 and f"system {shown[0]['system']} belongs to user {NUMBERS[0]}" in output
    assert users[0].types("down")[0] == 0
    assert users[1].status()["system"] == shown[1]["system"]  # it has lost nothing
    code, output = users[0].types("status")
    assert code == 1 and shown[1]["system"] not in output
    assert re.search("1 system of another user is|[0-9]+ systems of other users are", output), output  # and tests
