"""The container's image: what it copies is in the tree and not ignored, its user is not root, its health is a verb."""

from __future__ import annotations

import json
import tomllib

from tests.conftest import ROOT
from trocar.tools import cli

LINES = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ").splitlines()


def words(instruction: str) -> list[str]:
    """What follows each instruction of this name."""
    return [line.partition(" ")[2] for line in LINES if line.startswith(f"{instruction} ")]


def test_an_image_has_what_its_wheel_is_built_from() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    kept = {line[1:] for line in ignored if line.startswith("!")}
    assert all((ROOT / name).exists() for name in kept)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packed = project["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    needed = {*(name.strip("/") for name in packed), project["project"]["readme"], "LICENSE", "constraints.txt"}
    assert all(name in kept or name.split("/")[0] in kept for name in needed)


def test_it_does_not_run_as_root_and_its_health_and_entry_are_verbs() -> None:
    assert words("USER")[-1] not in ("0", "root")
    verbs = {verb.name for verb in cli.VERBS}
    (health,) = (json.loads(line.partition("CMD ")[2]) for line in words("HEALTHCHECK"))
    (entry,), (default,) = map(json.loads, words("ENTRYPOINT")), map(json.loads, words("CMD"))
    assert entry == health[:1] == ["trocar"] and {health[1], default[0]} <= verbs
