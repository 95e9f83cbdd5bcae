"""Other users of this machine, without accounts, whose programs run with this interpreter. Needs root."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
KEPT: Final = "dac_read_search"  # the interpreter of the tests may lie in a home that only root can read


@dataclass(frozen=True, slots=True)
class UserSim:
    """A user by an id that no account has."""

    number: int
    home: Path

    @classmethod
    @contextlib.contextmanager
    def several(cls, numbers: Iterable[int]) -> Iterator[list[UserSim]]:
        """Users with these ids, each with a home; at the end of the block, their systems go down."""
        with tempfile.TemporaryDirectory(dir="/tmp", ignore_cleanup_errors=True) as folder:
            Path(folder).chmod(0o755)  # those of pytest are root's alone
            users = [cls(number, Path(folder) / str(number)) for number in numbers]
            for user in users:
                user.home.mkdir()
                os.chown(user.home, user.number, user.number)
            try:
                yield users
            finally:
                for verb in [user.start("down") for user in users]:
                    verb.communicate(timeout=180.0)

    def start(self, *words: str) -> subprocess.Popen[str]:
        """A verb that this user types."""
        become = ("setpriv", f"--reuid={self.number}", f"--regid={self.number}", "--clear-groups",
                  f"--inh-caps=+{KEPT}", f"--ambient-caps=+{KEPT}", "--")
        kept = {name: text for name, text in os.environ.items() if not name.startswith("TROCAR_")}
        return subprocess.Popen(
            [*become, sys.executable, "-m", "trocar", *words], cwd=ROOT, text=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, env={**kept, "HOME": str(self.home), "XDG_STATE_HOME": "",
                                           "PYTHONDONTWRITEBYTECODE": "1"})

    def types(self, *words: str) -> tuple[int, str]:
        """Exit code and output of a verb."""
        verb = self.start(*words)
        output = verb.communicate(timeout=180.0)[0]
        return verb.returncode, output

    def status(self) -> dict[str, Any]:
        """The status of the only system that this user sees."""
        output = self.types("status", "--json")[1]
        found: dict[str, Any] = json.loads(output)
        return found
