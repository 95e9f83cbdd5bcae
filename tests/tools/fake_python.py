"""A copy of tools/start, tools/test and tools/venv.sh in a folder, with fake Pythons that install nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("sh", "dirname", "cat", "cksum", "sed", "sort", "tee", "tail", "head", "grep", "rm", "mv", "mkdir", "cp",
          "find", "xargs", "tr", "flock")
FAKE = """#!/bin/sh
case "$*" in
    -c*) echo "{version} {able} $0" ;;
    --version) echo "Python {version}" ;;
    "-m venv "*) mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; echo "home = {version}" > "$3/pyvenv.cfg" ;;
    *"pip install"*)
        echo "Collecting numpy"; echo "  details"; echo "ERROR: first"; echo "ERROR: no numpy" >&2; echo "a word"
        echo "$PIP_SAYS"
        for last; do :; done
        echo "{version} $last" >> "$INSTALLED"
        mkdir -p "${{0%/bin/python}}/lib/python/site-packages/numpy-2.dist-info"
        echo "#!$0" > "${{0%/python}}/trocar"
        exit ${{PIP_CODE:-0}} ;;
    *compileall* | *native.build*) ;;
    *) echo "$@" ;;
esac
"""


class ProjectCopy:
    """The copy of the scripts, with a PATH that has no Python."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.programs = folder.parent / "bin"
        self._installed = folder.parent / "installed"
        (folder / "tools").mkdir(parents=True)
        self.programs.mkdir()
        for name in ("tools/start", "tools/test", "tools/venv.sh", "pyproject.toml", "constraints.txt"):
            shutil.copy(ROOT / name, folder / name)
        for name in NEEDED:
            (self.programs / name).symlink_to(str(shutil.which(name)))
        self.program("uname", "echo x86_64")
        self.environment = {"PATH": str(self.programs), "HOME": os.environ.get("HOME", "/"), "TERM": "xterm",
                            "INSTALLED": str(self._installed)}

    def program(self, name: str, text: str) -> Path:
        """Put a shell script on the PATH."""
        file = self.programs / name
        file.write_text(text if text.startswith("#!") else f"#!/bin/sh\n{text}\n")
        file.chmod(0o755)
        return file

    def python(self, version: str, able: str = "venv") -> Path:
        """Put a fake Python on the PATH; `bare`: one that cannot make environments."""
        name = f"python{version}" if version in ("3.11", "3.12", "3.13", "3.14") else "python3"
        return self.program(name, FAKE.format(version=version, able=able))

    def ask(self, script: str = "start", *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run a script of the copy."""
        return subprocess.run([self.folder / "tools" / script, *words], env=self.environment | environment,
                              capture_output=True, text=True, timeout=60, check=False)

    def installed(self) -> list[str]:
        """The calls of pip since the last question: version of Python, extras."""
        if not self._installed.exists():
            return []
        calls = self._installed.read_text().replace(str(self.folder), "").splitlines()
        self._installed.unlink()
        return calls
