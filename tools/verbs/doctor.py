"""`trocar doctor`: look at this machine."""

from __future__ import annotations

import dataclasses

from trocar.tools.inspect.machine import BAD, findings
from trocar.tools.output.printing import emit, tell
from trocar.tools.verbs.options import JsonOption


def doctor(as_json: JsonOption = False) -> int:
    """Check this machine (kernel, permissions, cores, memory, ports, network, free CPU) and print a fix for each
    problem.

    Changes nothing. Exit code 1: a robot would not run well. Findings marked "note" do not count; they do not matter
    for first trials.

    Example: trocar doctor
    """
    bad = 0
    for finding in findings():
        bad += finding.state == BAD
        if as_json:
            emit(dataclasses.asdict(finding))
            continue
        tell(f"{finding.state:5} {finding.check:16} {finding.found}", flush=True, indent=f"{'':23}")
        if finding.mend:
            tell(f"{'':22} → {finding.mend}", indent=None)
    return 1 if bad else 0
