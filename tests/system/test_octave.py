"""MATLAB's classes (tools/matlab) in real Octave, with its package instrument-control; tools/peers installs both."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.system.robot import ROOT, Robot
from tests.system.test_socket_bridge import PATIENT, free, has_octave, started

pytestmark = [pytest.mark.peers, pytest.mark.slow, pytest.mark.simulated("paced"),
              pytest.mark.skipif(not has_octave(), reason="no Octave with instrument-control: tools/peers installs it")]
PACKAGE = ROOT / "tools" / "matlab"
SCRIPT = Path(__file__).parent / "octave_words.m"
EXAMPLES = re.findall(r"^    trocar up (\S+) [^\n]*\n\n```matlab\n(.*?)```", (ROOT / "docs" / "matlab.md").read_text(),
                      re.DOTALL | re.MULTILINE)
CONSOLE = ROOT / "configs" / "systems" / "demo-teleop.yaml"


def octave(robot: Robot, code: str) -> subprocess.Popen[str]:
    """Octave at work on some code, with the package on its path."""
    head = f"warning('off', 'Octave:shadowed-function'); addpath('{PACKAGE}');\n"
    return subprocess.Popen(["octave-cli", "--eval", head + code], env=robot.environment, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def said(robot: Robot, code: str) -> str:
    """What it printed; fails when it failed."""
    with octave(robot, code) as running:
        out, err = running.communicate(timeout=240)
    robot.pids.add(robot.pid("socket_bridge"))
    assert running.returncode == 0, out + err
    return out


@pytest.mark.parametrize(("file", "code"), EXAMPLES, ids=[Path(file).stem for file, _ in EXAMPLES])
def test_an_example_of_the_page_runs(robot: Robot, file: str, code: str) -> None:
    port = free()
    robot.up(ROOT / file, "--set", f"socket.listen=127.0.0.1:{port}", *PATIENT)
    out = said(robot, code.replace("7380", str(port)))
    assert "trocar:refused" in out or "full" in file
    assert robot.down() == 0


def test_both_systems_of_the_page_have_an_example() -> None:
    assert len(EXAMPLES) == 2


def test_every_word_does_what_it_says_on_emulated_boards(robot: Robot) -> None:
    at = f"127.0.0.1:{free()}"
    robot.up(CONSOLE, "--set", f"socket.listen={at}", *PATIENT)
    with octave(robot, f"at = '{at}';\nsource('{SCRIPT}');") as running:
        assert running.stdout is not None and running.stderr is not None
        lines = iter(running.stdout.readline, "")
        heard = list(iter(lambda: next(lines, "all words\n"), "all words\n"))
        if running.poll() is None:
            robot.pids.add(robot.kill("socket_bridge"))
        out, err = running.communicate(timeout=120)
    robot.pids.add(robot.pid("socket_bridge"))
    assert running.returncode == 0 and "back again" in out, "".join(heard) + out + err
    assert robot.down() == 0


def test_a_client_without_the_token_is_refused(robot: Robot, tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("0123456789abcdef0123\n")
    token.chmod(0o600)
    port = started(robot, "--set", f"socket.token_file={token}", *PATIENT, address=f"0.0.0.0:{free()}")
    out = said(robot, f"""
        try, trocar.psm('PSM1', '127.0.0.1:{port}', 'another'); catch reason, disp(reason.identifier), end
        psm = trocar.psm('PSM1', '127.0.0.1:{port}', strtrim(fileread('{token}')));
        disp(psm.operating_state())
        try, psm.enable(); catch reason, disp(reason.message), end
    """)
    assert out.split("\n")[:2] == ["trocar:refused", "DISABLED"]
    assert "is read-only" in out
    assert robot.down() == 0


def test_a_wait_counts_the_robot_s_time_where_that_is_slower(robot: Robot) -> None:
    port = started(robot, *PATIENT)
    out = said(robot, f"""
        psm = trocar.psm('PSM1', '127.0.0.1:{port}');
        limit = trocar.deadline(psm.bridge, 'PSM1', 0.2);
        pause(0.1), disp(limit.is_over())
        begun = tic;
        while ~limit.is_over(), pause(0.01); end
        disp(toc(begun) < 20)
    """)
    assert out.split() == ["0", "1"]
    assert robot.down() == 0


