"""`trocar stop` and `restart` where there is no terminal to ask on."""

from __future__ import annotations

import re
from typing import Any

import pytest
from typer.testing import CliRunner

from tests.tools.robot import robot
from trocar.tools import cli


@pytest.mark.parametrize("what", ["stop", "restart"])
def test_without_a_terminal_nothing_is_done_and_the_whole_command_is_named(what: str, world: Any) -> None:
    with robot(world.name) as made:
        done = CliRunner().invoke(cli.build(), [what, "IO1", "--system", made.name])
    said = " ".join(re.sub("[│╭╰─╮╯]", " ", done.output).split())
    assert done.exit_code == 2
    assert said.count("When IO1 ends, its robots lose power") == 1 and "depends on it: PSM1 (arm)" in said
    assert f"trocar {what} IO1 --system {made.name} --yes" in said
