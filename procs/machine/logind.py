"""systemd-logind, which removes the shared memory of a login user when the user's last session ends (RemoveIPC)."""

from __future__ import annotations

import contextlib
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from trocar.shm.memory import owners

SYSTEM_UID_MAX: Final = 999  # of systemd; /etc/login.defs may have another one
ASK: Final = ("busctl", "--system", "get-property", "org.freedesktop.login1", "/org/freedesktop/login1",
              "org.freedesktop.login1.Manager", "RemoveIPC")
PATIENCE_S: Final = 3.0


def at_logout(uid: int, root: Path = Path("/"), ask: Sequence[str] = ASK) -> tuple[str, str]:
    """What logind does to a running system of this user, and the command that prevents it; both empty: nothing.

    It spares system users, and those that linger. Without an answer from logind: its default, to remove.
    """
    name = owners.user(uid).removeprefix("user ")
    limit = re.search(r"^SYS_UID_MAX\s+(\d+)", _text(root / "etc/login.defs"), re.MULTILINE)
    is_login = uid > (int(limit[1]) if limit else SYSTEM_UID_MAX)
    lingers = (root / "var/lib/systemd/linger" / name).exists()
    if not is_login or lingers or not (root / "run/systemd/users").is_dir() or not _removes(ask):
        return "", ""
    return (f"when {name} logs out, logind removes the shared memory of running systems (RemoveIPC)",
            f"sudo loginctl enable-linger {name}    # or another remedy in docs/operating.md")


def _removes(ask: Sequence[str]) -> bool:
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        answer = subprocess.run(ask, capture_output=True, text=True, timeout=PATIENCE_S, check=False).stdout
        return answer.split() != ["b", "false"]
    return True


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
