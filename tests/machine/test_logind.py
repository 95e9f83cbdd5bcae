"""Whose shared memory logind removes at logout."""

from __future__ import annotations

from pathlib import Path

import pytest

from trocar.procs.machine.logind import at_logout

UID = 54321
ON, OFF, SILENT = ("echo", "b true"), ("echo", "b false"), ("false",)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A machine with logind."""
    for folder in ("run/systemd/users", "var/lib/systemd/linger", "etc"):
        (tmp_path / folder).mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize("ask", [ON, SILENT, ("/no/such/program",)])
def test_a_login_user_is_warned_with_the_remedy(root: Path, ask: tuple[str, ...]) -> None:
    wrong, mend = at_logout(UID, root, ask)
    assert "RemoveIPC" in wrong and mend.startswith(f"sudo loginctl enable-linger {UID}")


def test_nobody_else_is_warned(root: Path) -> None:
    assert not any(at_logout(UID, root, OFF))
    assert not any(at_logout(0, root, ON)) and not any(at_logout(999, root, ON))
    (root / "etc/login.defs").write_text(f"SYS_UID_MAX {UID}\n")
    assert not any(at_logout(UID, root, ON)) and any(at_logout(UID + 1, root, ON))
    (root / f"var/lib/systemd/linger/{UID + 1}").touch()
    assert not any(at_logout(UID + 1, root, ON))
    (root / "run/systemd/users").rmdir()
    assert not any(at_logout(UID + 2, root, ON))


