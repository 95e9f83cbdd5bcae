"""A bring-up that one program has under way, and a hold that another one sends meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from trocar.procs.config import load_system
from trocar.procs.host.host import Host
from trocar.shm.mailbox.client import begin

pytestmark = pytest.mark.slow
PERIODS = [f"{section}.period_s=0.002" for section in ("io", "arm", "emulation")]


@pytest.fixture
def host() -> Iterator[Host]:
    loaded = load_system(Path("configs/systems/demo.yaml"), name="xhold", sets=["clock=paced", *PERIODS],
                         search=[Path("configs")], boards="emulated")
    assert loaded.system is not None, loaded.errors
    made = Host(loaded.system, 64)
    made.run(0.1)
    yield made
    made.close()


@pytest.mark.parametrize("while_", ["POWERING", "DISABLED", "ENABLED"])
def test_after_a_hold_no_earlier_bring_up_powers_or_homes_an_arm(host: Host, while_: str) -> None:
    program, person, state = host.client("PSM1"), host.client("PSM1"), host.reader("PSM1")
    program.on_behalf(begin(host.name))  # all steps are one command, as those of `trocar home`

    def shown() -> str:
        state.newest()
        return str(state.field("sub_state").item().decode())

    def runs_until(wanted: str) -> None:
        for _ in range(500):
            if shown() == wanted:
                return
            host.run(0.01)
        pytest.fail(f"{wanted} was not reached: {shown()}")

    def outcome(word: str) -> list[str]:
        number = program.send("state_command", (), word)
        host.run(0.5)
        return [reply.outcome for reply in program.poll() if reply.id == number]

    if while_ != "DISABLED":
        program.send("state_command", (), "enable")
    runs_until(while_)
    person.send("hold")
    host.run(3.0)
    stopped = shown()
    assert stopped == {"POWERING": "ENABLED", "ENABLED": "PAUSED"}.get(while_, while_)
    assert outcome("home" if while_ != "DISABLED" else "enable") == ["refused"]
    host.run(1.0)
    assert shown() == stopped
    for word in ("resume",) * (while_ == "ENABLED") + ("enable",) * (while_ == "DISABLED"):  # a new command of a person
        person.send("state_command", (), word)
    runs_until("ENABLED")
    person.send("state_command", (), "home")
    host.run(0.2)
    assert shown() not in ("ENABLED", "PAUSED", "FAULT"), "homing"
