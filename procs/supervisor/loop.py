"""The supervisor's process. It first forks the template and the reader of the configuration: all three then import."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Final

from trocar.procs.machine.imports import many_imports
from trocar.procs.machine.open_files import raise_limit

ENVIRON: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",  # no thread pools in control code
                  "PYTHONIOENCODING": "utf-8"}  # logs are UTF-8, whatever the terminal of `up` is


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
    parser.add_argument("--room", help="spaces, where the forks of this process show their own command lines")
    return parser.parse_args()


def main() -> None:
    """Exit code 0: stopped on request, 1: error in configuration or setup, or a process that was given up."""
    chosen = arguments()
    raise_limit()  # before there is a process that inherits it
    os.environ |= ENVIRON  # before numpy is imported
    with many_imports():
        from trocar.procs.supervisor.configuration import Configuration
        from trocar.procs.supervisor.forking import Template
        from trocar.procs.supervisor.template import show

    template = Template()
    if chosen.room:  # else the command lines of its forks would be cut, by which processes are found
        show(sys.orig_argv[:-2])
        template.start()
    configuration = Configuration(chosen)
    with many_imports():
        from trocar.procs.supervisor.run import run

    sys.exit(run(chosen, configuration, template))


if __name__ == "__main__":
    main()
