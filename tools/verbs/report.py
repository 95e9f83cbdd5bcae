"""`trocar report`: everything for a bug report in one archive."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final

import typer

from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import answer, note, progress
from trocar.tools.verbs.options import JsonOption, SystemOption

RECORDINGS_MB: Final = 200.0


def report(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]", help="A new .tar.gz file; default: here, named by "
                                                "system and time.")] = None,
    recordings: Annotated[float, typer.Option("--recordings", min=0.0, metavar="MB", help="Maximum size of all "
                                              "recordings, newest first.")] = RECORDINGS_MB,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Pack logs, recordings, configuration, versions and what `doctor` says into one archive, for a bug report.

    Works after the system has stopped, too; then give --system. The archive also contains what is now in the system's
    shared memory. Tokens are left out; CONTENTS.txt in the archive lists its files: check it before you pass it on.

    Example: trocar report
    """
    from trocar.tools.systems import report_file as reporting

    name = reporting.system_meant(system)
    return pack(name, file or Path(f"trocar-report-{name}-{datetime.now():%Y%m%d-%H%M%S}.tar.gz"), recordings, as_json)


def pack(name: str, file: Path, recordings: float, as_json: bool, also: Sequence[Path] = ()) -> int:
    """Pack a system, `also` further files of text, and show what was packed; `recordings`: MB."""
    from trocar.tools.systems import report_file as reporting

    try:
        with progress(f"packing {name}") as say:
            found = reporting.report(name, file, round(recordings * 1e6), say, also)
        size = file.stat().st_size
    except FileExistsError:
        raise Problem(f"{file}: is there already; give another name") from None
    except OSError as error:
        raise Problem(f"{file}: cannot be written: {error.strerror or error}") from None
    for problem in found.problems:
        note(problem)
    answer(dataclasses.asdict(found) | {"file": str(file), "bytes": size},
           f"{file}: {len(found.files)} files, {size / 1e6:.1f} MB", as_json)
    return 0
