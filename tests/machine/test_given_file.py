"""Files that a person names are found as those are that files name."""

from __future__ import annotations

from pathlib import Path

import pytest

from trocar.procs.machine.paths import PROJECT_CONFIGS, given_file, not_found


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "share").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_callers_own_file_comes_first(elsewhere: Path) -> None:
    for folder in (elsewhere, elsewhere / "share"):
        (folder / "demo.yaml").touch()
    assert given_file(Path("demo.yaml"), [elsewhere / "share"]) == Path("demo.yaml")
    (elsewhere / "demo.yaml").unlink()
    assert given_file(Path("demo.yaml"), [elsewhere / "share"]) == elsewhere / "share" / "demo.yaml"
    (elsewhere / "share" / "demo.yaml").unlink()
    assert given_file(Path("demo.yaml")) == PROJECT_CONFIGS / "systems" / "demo.yaml"


@pytest.mark.parametrize(("name", "found"), [
    ("configs/systems/demo.yaml", "systems/demo.yaml"), ("systems/demo.yaml", "systems/demo.yaml"),
    ("kinematic/PSM.json", "kinematic/PSM.yaml"),
])
def test_our_own_files_are_found_from_any_folder(elsewhere: Path, name: str, found: str) -> None:
    assert given_file(Path(name)).resolve() == PROJECT_CONFIGS / found


def test_a_file_that_is_nowhere_is_told_with_what_is_like_it(elsewhere: Path) -> None:
    assert given_file(Path("systems/demmo.yaml")) == Path("systems/demmo.yaml")
    reported = not_found(Path("systems/demmo.yaml"), [elsewhere / "share"])
    assert "did you mean systems/demo.yaml?" in reported and str(elsewhere / "share") in reported
    assert given_file(Path("x" * 300)) == Path("x" * 300)
