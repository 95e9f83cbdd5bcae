"""`trocar new-arm`: the files of an arm that has never run with the dVRK, from the manufacturer's `.cal` file."""

from __future__ import annotations

import re
import shlex
import shutil
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from trocar.procs.config import check_file
from trocar.tools.converters import to_json
from trocar.tools.new_arm.arm_file import arm_file, system_file, uncalibrated
from trocar.tools.new_arm.arm_numbers import ARMS, BOARDS, CLASSIC, NAMES, SI, ArmNumbers
from trocar.tools.new_arm.cal_file import CalFile, read_cal
from trocar.tools.new_arm.io_file import NewArm, gripper_file, io_file
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit, tell
from trocar.tools.output.replacing import put
from trocar.tools.verbs.options import JsonOption, PathOption

HARDWARE = {CLASSIC: ("QLA1", "DQLA"), SI: ("dRA1",)}
IDS = range(16)
KINDS = {"MTM": "MTM_CAL", "PSM": "PSM_CAL", "ECM": "ECM_CAL"}


def new_arm(
    name: Annotated[str, typer.Option("--name", metavar="ARM", help=f"Name of the arm: {', '.join(NAMES)}.")],
    cal: Annotated[Path | None, typer.Option(
        "--cal", metavar="FILE", help="The manufacturer's .cal file of this very arm (Classic).")] = None,
    generation: Annotated[str, typer.Option("--generation", metavar="GENERATION", help="Classic or Si.")] = CLASSIC,
    boards: Annotated[str, typer.Option(
        "--boards", metavar="HARDWARE", help="Hardware of the controllers: QLA1, DQLA (Classic) or dRA1 (Si); default: "
        "QLA1 or dRA1.")] = "",
    ids: Annotated[str, typer.Option("--ids", metavar="N,N", help="Board ids, as set by the rotary switches; default: "
                                     "those of the arm's name.")] = "",
    serial: Annotated[str, typer.Option("--serial", metavar="NUMBER", help="Serial number; default: that of the .cal "
                                        "file.")] = "",
    port: Annotated[str, typer.Option("--port", metavar="PORT", help="Port to write into the system file.")] = "fw",
    to: Annotated[Path, typer.Option("--to", metavar="FOLDER", help="Folder of the new files.")] = Path(),
    path: PathOption = None,
    as_json: JsonOption = False,
) -> int:
    """Write the IO, arm and system files of an arm that has never run with the dVRK, and list what is not calibrated.

    A Classic arm needs --cal, an Si arm --serial.

    Example: trocar new-arm --name PSM1 --generation Si --serial 12345 --to new-site
    """
    arm = _chosen(name, cal, generation, boards, ids, serial, port)
    files = {f"sawRobotIO1394-{name}-{arm.serial}.json": to_json(io_file(arm)),
             f"{name}-{arm.serial}.json": arm_file(arm), f"system-{name}.json": system_file(arm)}
    if arm.numbers.type == "MTM":
        files[f"sawRobotIO1394-{name}-gripper-{arm.serial}.json"] = to_json(gripper_file(arm))
    _check(files, f"system-{name}.json", tuple(path or ()))
    to.mkdir(parents=True, exist_ok=True)
    kept = {file: put(to / file, text, lambda fresh: None) for file, text in files.items()}
    if as_json:
        emit({"files": [str(to / file) for file in files], "kept": [str(old) for old in kept.values() if old],
              "uncalibrated": uncalibrated(arm)})
        return 0
    for file, old in kept.items():
        tell(f"wrote {to / file}" + (f"; the file that was there is {old} now" if old else ""))
    for line in uncalibrated(arm):
        tell(f"not calibrated: {line}")
    tell(f"next: trocar check {shlex.quote(str(to / f'system-{name}.json'))}")
    return 0


def _chosen(name: str, cal: Path | None, generation: str, boards: str, ids: str, serial: str, port: str) -> NewArm:
    numbers = ARMS.get((name, generation))
    if name not in NAMES or generation not in HARDWARE:
        raise Misuse(f"--name {name} --generation {generation}: allowed are {', '.join(NAMES)}, and Classic or Si")
    if numbers is None:
        raise Misuse(f"--generation {generation}: the masters of an Si system are not supported")
    hardware = boards or HARDWARE[generation][0]
    if hardware not in HARDWARE[generation]:
        raise Misuse(f"--boards {boards}: allowed for {generation} are {', '.join(HARDWARE[generation])}")
    found = None
    if generation == CLASSIC:
        if cal is None:
            raise Misuse(f"{name} needs --cal: its potentiometers are described there alone")
        found = read_cal(cal)
        serial = _serial(found, numbers, name, serial)
    elif cal is not None:
        raise Misuse("--cal: the .cal file of an Si arm is not used; give --serial alone")
    if not re.fullmatch(r"[0-9]{1,9}", serial):
        raise Misuse(f"--serial {serial or 'is missing'}: a serial number has digits only")
    return NewArm(name, generation, hardware, _ids(ids, name, hardware), serial, port, numbers, found)


def _serial(cal: CalFile, numbers: ArmNumbers, name: str, serial: str) -> str:
    kind, stated = cal.one("FileType"), cal.one("serial_number")
    if kind != KINDS[numbers.type]:
        raise Problem(f"{cal.path} is a {kind or 'file without FileType'}; a {name} needs a {KINDS[numbers.type]}")
    if not isinstance(stated, float) or stated % 1:
        raise Problem(f"{cal.path}: serial_number is missing, or no whole number")
    if serial and serial != f"{stated:.0f}":
        raise Problem(f"--serial {serial}: {cal.path} is of the arm {stated:.0f}")
    return f"{stated:.0f}"


def _ids(ids: str, name: str, hardware: str) -> tuple[int, ...]:
    """The board ids: two of QLA1; of other hardware, only the first is used."""
    parts = ids.split(",") if ids else [str(board) for board in BOARDS[name]]
    needed = 2 if hardware == "QLA1" else 1
    chosen = [int(part) for part in parts if part.strip().isdecimal() and int(part) in IDS]
    if len(chosen) != len(parts) or len(set(chosen)) != len(chosen) or len(chosen) < needed:
        raise Misuse(f"--ids {ids}: {needed} different numbers from 0 to {IDS[-1]}, separated by commas")
    return tuple(chosen[:needed])


def _check(files: dict[str, str], system: str, search: tuple[Path, ...]) -> None:
    """Problem if the files together have an error other than that they are not calibrated."""
    folder = Path(tempfile.mkdtemp(prefix="trocar-new-arm-"))
    try:
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        problems = check_file(folder / system, search=search, sets=("calibration_mode=true",)).problems
        errors = [problem for problem in problems if problem.severity == "error"]
        if errors:
            raise Problem(f"the files would not be valid: {errors[0]}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
