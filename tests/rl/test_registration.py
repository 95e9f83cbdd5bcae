"""How people come to the environments: by `trocar.rl`, and by their names in Gymnasium."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NO_PICTURES = {**os.environ, "PYTHONPATH": str(ROOT), "MUJOCO_GL": "disable"}  # else MuJoCo looks for a window library


def python(code: str) -> str:
    """What a fresh interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120,
                          env=NO_PICTURES, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_scripts_do_without_gymnasium_until_they_ask_for_it() -> None:
    loaded = python("import sys, trocar\nprint(*({'gymnasium', 'trocar.procs.rl'} & set(sys.modules)))")
    assert not loaded


@pytest.mark.slow
def test_who_lacks_gymnasium_is_told_how_to_get_it() -> None:
    said = python("import sys, trocar\nsys.modules['gymnasium'] = None\n"
                  "try: trocar.rl\nexcept ModuleNotFoundError as error: print(error)\n"
                  "print(hasattr(trocar, 'rm'))")
    assert said.splitlines() == [f"trocar.rl needs gymnasium: {sys.executable} -m pip install 'trocar[rl]'", "False"]


@pytest.mark.slow
def test_once_registered_gymnasium_makes_all_by_their_names() -> None:
    said = python("import trocar, gymnasium\ngymnasium.register_envs(trocar.rl)\n"
                  "names = [n for n in gymnasium.registry if n.startswith('trocar/')]\n"
                  "for n in names: gymnasium.make(n, starts=1).close()\nprint(*sorted(names))")
    assert said == "trocar/EcmAim-v0 trocar/PsmHandOver-v0 trocar/PsmPush-v0 trocar/PsmReach-v0 trocar/PsmTrack-v0"


@pytest.mark.slow
@pytest.mark.parametrize("lines", [
    "import gymnasium, trocar\nmake = lambda: gymnasium.make('trocar.procs.rl.door:trocar/PsmReach-v0', starts=1)",
    "import gymnasium\nmake = lambda: gymnasium.make('trocar:trocar/PsmReach-v0', starts=1)",
    "import trocar, gymnasium\ntrocar.rl\nmake = lambda: gymnasium.make('trocar:trocar/PsmReach-v0', starts=1)"])
def test_what_the_page_says_finds_them_whatever_is_imported_first(lines: str) -> None:
    said = python(f"{lines}\nenv = make()\nimport trocar\n"
                  "print(type(env.unwrapped) is trocar.rl.PsmReach)\nenv.close()")
    assert said == "True"
