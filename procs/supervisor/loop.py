"""The supervisor's process. It starts the template first, so that both import modules at the same time."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trocar.procs.machine.imports import many_imports
from trocar.procs.machine.open_files import raise_limit
from trocar.procs.supervisor.forking import Template


def arguments() -> argparse.Namespace:
    """The command line; `trocar up` passes its own options on."""
    parser = argparse.ArgumentParser(prog="supervisor", description="Run one system; see trocar up --help.")
    parser.add_argument("file", type=Path)
    parser.add_argument("--system")
    parser.add_argument("--boards", choices=["emulated"])
    parser.add_argument("--path", type=Path, action="append", default=[])
    parser.add_argument("--set", dest="sets", action="append", default=[])
    parser.add_argument("--for", dest="seconds", type=float)
    parser.add_argument("--document", action="store_true", help="the file is a frozen document, as recordings have it")
    parser.add_argument("--held", action="store_true", help="simulated time does not start until a program controls it")
    return parser.parse_args()


def main() -> None:
    """Exit code 0: stopped on request, 1: error in configuration or setup, or a process that was given up."""
    chosen, template = arguments(), Template()
    raise_limit()  # before there is a process that inherits it
    template.start()
    with many_imports():
        from trocar.procs.supervisor.run import run  # takes as long as the template's imports meanwhile

    sys.exit(run(chosen, template))


if __name__ == "__main__":
    main()
