"""`trocar bench NAME`: measurements, one module each."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from trocar.procs.machine.extras import missing_in
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit, table, tell
from trocar.tools.verbs.options import JsonOption

BENCHES: Final = {
    "ring": "ring", "io": "io_loop", "boards": "boards", "arm": "arm", "teleop": "teleop", "start": "start",
    "lifecycle": "lifecycle", "deaths": "deaths", "bridges": "bridges", "recorder": "recorder", "rl": "rl",
    "gui": "gui", "system": "system",
}
"""By name: the module in tools/bench. Its `run` takes options of the verb by their names, and returns `figures` and
`conditions`, perhaps `problems` and more; `show`, where there is one, prints what is more."""


def bench(
    name: Annotated[str, typer.Argument(
        metavar="NAME", help=f"Measurement to run: {', '.join(BENCHES)} (docs/benchmarks.md).")],
    file: Annotated[Path | None, typer.Argument(
        metavar="[SYSTEM]", help="System file, only for `system`; default: a supplied file.")] = None,
    path: Annotated[list[Path] | None, typer.Option(
        "--path", help="Additional folder to search for files, only for `system`.")] = None,
    boards: Annotated[str, typer.Option(
        "--boards", help="`emulated`: without hardware; only for `system`.")] = "",
    seconds: Annotated[float, typer.Option(
        "--seconds", min=0.0, show_default=False,
        help="Duration in s, for teleop, system, bridges, gui, recorder and rl; each has its own default.")] = 0.0,
    browser: Annotated[bool, typer.Option(
        "--browser", help="Also measure in the Chromium browser; only for gui.")] = False,
    sets: Annotated[list[str] | None, typer.Option(
        "--set", metavar="KEY=VALUE", help="Value for a key of the system file, only for teleop and system.")] = None,
    as_json: JsonOption = False,
) -> Any:
    """Measure the speed of this machine and of Trocar. The figures are times and ratios from one run.

    If the native library is compiled, it is used. With TROCAR_NATIVE=0 in the environment, numpy is used instead.

    Example: trocar bench system --seconds 5 --json
    """
    if name not in BENCHES:
        raise Misuse(f"no bench {name}; there are: {', '.join(BENCHES)}")
    if boards not in ("", "emulated"):
        raise Misuse(f"--boards {boards}; allowed: emulated")
    try:
        module = importlib.import_module(f"trocar.tools.bench.{BENCHES[name]}")
    except ModuleNotFoundError as error:
        raise Problem(f"bench {name} cannot run: {missing_in(error) or error}") from None
    from trocar.tools.bench.measuring import machine  # with numpy, which only a bench asks for

    given = {"file": file, "paths": tuple(path or ()), "boards": boards, "seconds": seconds,
             "browser": browser, "sets": tuple(sets or ())}
    options = {key: value for key, value in given.items() if value}
    if left := [key for key in options if key not in inspect.signature(module.run).parameters]:
        raise Misuse(f"bench {name} takes no {' and no '.join(left)}")
    found: dict[str, Any] = module.run(**options)
    own = found["conditions"]
    result = {"bench": name, **found, "conditions": own | machine() | own}  # its own come first, and count
    problems = found.get("problems", [])
    if as_json:
        emit(result)
        return int(bool(problems))
    for part in ("figures", "conditions"):
        rows = [(key, f"{x:.6g}" if isinstance(x, float) else str(x)) for key, x in result[part].items()]
        table(f"bench {name}: {part}", (part, "value"), rows, right=("value",) if part == "figures" else ())
    if hasattr(module, "show"):
        module.show(result)
    for problem in problems:
        tell(f"PROBLEM: {problem}")
    return int(bool(problems))
