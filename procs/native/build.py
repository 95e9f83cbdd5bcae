"""Compiles the native library into the Python environment: python -m trocar.procs.native.build [--sanitize FILE]

tools/start and tools/test do that, once for each source and compiler. Where it fails all runs without, slower.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from trocar.procs.native.sources import FLAGS, files, header, library_path, source_hash

SANITIZE: Final = ("-g", "-Werror", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


class BuildError(Exception):
    """No compiler was found, or it failed."""


def build(to: Path, sanitize: bool = False) -> None:
    """Compile into the file `to`, which exists completely or not at all; BuildError gives the reason of a failure."""
    names = [str(path) for path in files() if path.suffix == ".c"]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "fields.h").write_text(header())
        made = Path(folder) / "native.so"
        command = [os.environ.get("CC", "cc"), *FLAGS, *(SANITIZE if sanitize else ()), f"-I{folder}",
                   f"-DNATIVE_HASH={source_hash()}", *names, "-o", str(made), "-lm"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        except FileNotFoundError as error:
            raise BuildError(f"found no compiler {command[0]}; do: sudo apt-get install gcc libc6-dev") from error
        except (OSError, subprocess.TimeoutExpired) as error:
            raise BuildError(f"{command[0]}: {error}") from error
        if done.returncode:
            raise BuildError(done.stderr.strip())
        to.parent.mkdir(parents=True, exist_ok=True)
        beside = to.with_name(f"{to.name}.{os.getpid()}")
        beside.write_bytes(made.read_bytes())
        beside.replace(to)


def main() -> None:
    """Build, or print the reason of a failure."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--sanitize", metavar="FILE", help="with the address and undefined behaviour sanitizers")
    given = options.parse_args()
    try:
        build(Path(given.sanitize) if given.sanitize else library_path(), sanitize=bool(given.sanitize))
    except (BuildError, OSError) as error:
        sys.exit(f"trocar: the native library could not be compiled, numpy does its work: {error}")


if __name__ == "__main__":
    main()
