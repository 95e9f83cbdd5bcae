"""The token of the web console, if that is served to other machines and no token is configured: new at each start.

It is in a file that only its user may read, and in no log, no argument of a process and no shared memory.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
from collections.abc import Iterator
from typing import Final

from trocar.procs.document.system import SystemConfig
from trocar.procs.machine.paths import STATE_REMEDY, NoStateFolder, made_log_folder, token_file

BYTES: Final = 16


@contextlib.contextmanager
def gui_token(system: SystemConfig) -> Iterator[None]:
    """Provide the token's file within the block, if one is needed."""
    if system.gui is None or not system.gui.makes_token:
        yield
        return
    made_log_folder(os.environ, system.name)
    path = token_file(os.environ, system.name)
    path.unlink(missing_ok=True)  # of a supervisor that was killed
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600), "w") as file:
            file.write(f"{secrets.token_hex(BYTES)}\n")
    except OSError as error:
        path.unlink(missing_ok=True)
        raise NoStateFolder(f"cannot keep the token of the web console in {path}: {error.strerror}; {STATE_REMEDY}"
                            ) from None
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def told(system: SystemConfig, *, to_a_terminal: bool) -> str:
    """How browsers on other machines connect; contains the token only on a terminal, where only its user reads it."""
    if system.gui is None or not system.gui.makes_token:
        return ""
    path = token_file(os.environ, system.name)
    if not to_a_terminal:
        return f"gui: the token of this start is in {path}"
    links = system.gui.links(path.read_text().strip(), socket.gethostname())
    return f"gui: in a browser, until it goes down: {', '.join(links)}"
