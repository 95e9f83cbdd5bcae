"""The wheel: made from the source distribution, installed outside the checkout, beside a lab's own folders."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from tests.conftest import ROOT, World
from tests.system.robot import SLOWER

LABS_OWN = ("tools", "shm", "procs", "configs")


def run(*words: str | Path, cwd: Path, **more: str) -> str:
    """What a program printed; it has to end well."""
    done = subprocess.run([sys.executable, *map(str, words)], cwd=cwd, env={**os.environ, **more}, text=True,
                          capture_output=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of packages with the wheel in it, made from the sdist."""
    folder = tmp_path_factory.mktemp("wheel")
    run("-m", "hatchling", "build", "-t", "sdist", "-d", folder, cwd=ROOT)
    with tarfile.open(next(folder.glob("*.tar.gz"))) as archive:
        archive.extractall(folder, filter="data")
    run("-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=next(folder.glob("trocar-*/")))
    wheel = next(folder.glob("*.whl"))
    run("-m", "pip", "install", "-q", "--no-deps", "--no-compile", "--target", folder / "site", wheel, cwd=folder)
    return folder / "site"


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A folder that has packages with the names of ours."""
    for name in LABS_OWN:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"raise RuntimeError('this is the {name} of the lab')\n")
    return tmp_path


@pytest.mark.parametrize(("machine", "symbols", "tag"), [
    (62, b"GLIBC_2.2.5\0GLIBC_2.14\0", "manylinux_2_17_x86_64"),
    (183, b"GLIBC_2.17\0GLIBC_2.34\0", "manylinux_2_34_aarch64"),
])
def test_a_wheel_is_named_after_the_processor_and_the_newest_symbol(
        tmp_path: Path, machine: int, symbols: bytes, tag: str) -> None:
    spec = importlib.util.spec_from_file_location("wheel_hook", ROOT / ".ci/wheel_hook.py")
    assert spec is not None and spec.loader is not None
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    library = tmp_path / "native.so"
    library.write_bytes(b"\x7fELF".ljust(18, b"\0") + machine.to_bytes(2, "little") + symbols)
    assert hook.platform_tag(library) == tag


@pytest.mark.slow
def test_the_wheel_is_one_package(installed: Path) -> None:
    assert {path.name for path in installed.iterdir() if path.suffix != ".dist-info"} - {"bin"} == {"trocar"}
    inside = {path.name for path in (installed / "trocar").iterdir()}
    assert inside == {"__init__.py", "__main__.py", "py.typed", "procs", "shm", "tools", "configs"}
    assert (installed / "trocar/procs/native/native.so").exists()
    assert {"trocar.service", "trocar.rules"} <= {path.name for path in (installed / "trocar/tools").iterdir()}
    used = run("-c", "from trocar.procs.native.library import native; print(native().file)", cwd=installed,
               PYTHONPATH=str(installed), TROCAR_NATIVE="")
    assert Path(used.strip()).is_relative_to(installed)


@pytest.mark.slow
def test_a_script_beside_folders_of_our_names_imports_trocar(installed: Path, lab: Path) -> None:
    (lab / "script.py").write_text("import trocar\nprint(trocar.__file__, trocar.Psm.__name__)\n")
    file, kind = run("script.py", cwd=lab, PYTHONPATH=str(installed)).split()
    assert Path(file).is_relative_to(installed) and kind == "Psm"


@pytest.mark.slow
def test_the_demo_of_the_wheel_runs_beside_folders_of_our_names(installed: Path, lab: Path, world: World) -> None:
    run("-m", "trocar", "demo", "--for", "1", "--clock", "lockstep", *SLOWER, "--system", world.name, cwd=lab,
        PYTHONPATH=str(installed), TROCAR_STATE=str(lab / "state"))
