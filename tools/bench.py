"""`trocar bench NAME`: measurements, one module each."""

from __future__ import annotations

import importlib
from typing import Annotated, Any

import typer

from tools.errors import Misuse, Problem
from tools.options import JsonOption
from tools.printing import emit, table

BENCHES = {"ring": "tools.bench_ring", "io": "tools.bench_io", "boards": "tools.bench_boards",
           "arm": "tools.bench_arm"}


def bench(
    name: Annotated[str, typer.Argument(help=f"What to measure: {', '.join(BENCHES)}.")],
    as_json: JsonOption = False,
) -> Any:
    """Measure this machine and this software; figures are ratios or times of one run.

    Example: trocar bench ring --json
    """
    if name not in BENCHES:
        raise Misuse(f"no bench {name}; there are: {', '.join(BENCHES)}")
    try:
        module = importlib.import_module(BENCHES[name])
    except ModuleNotFoundError as error:
        raise Problem(f"bench {name} cannot run: {error}") from None
    result: dict[str, Any] = module.run()
    if as_json:
        emit(result)
        return 0
    for part in ("figures", "conditions"):
        rows = [(key, f"{x:.6g}" if isinstance(x, float) else str(x)) for key, x in result[part].items()]
        table(f"bench {name}: {part}", (part, "value"), rows, right=("value",) if part == "figures" else ())
    return 0
