"""`trocar bench io`: the I/O loop of a whole system on emulated boards: latency, period, missed deadlines, top speed.

Four PSMs (8 boards, 28 axes) in one io process, powered, homed and holding; everything as `trocar up` starts it. The
emulator and four arm processes share the machine's cores with io, which real boards would not.
"""

from __future__ import annotations

import copy
import os
import platform
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml

from shm import directory
from shm.clock import monotonic_ns, pause
from shm.ring import RingReader
from tools.arms import HOMED, bring
from tools.errors import Problem
from tools.processes import lives
from tools.supervising import Background, Request
from tools.systems import ROOT
from tools.watch import arm_names

PSMS = 4
SECONDS = 5.0
FAST_PERIOD_S = 1 / 8000
FIRST_BOARD = 6  # of the demo's PSM; copies begin at board 0
SOURCE = ROOT / "configs"


def run(seconds: float = SECONDS, psms: int = PSMS) -> dict[str, Any]:
    """Measure; returns the object that `--json` prints."""
    with tempfile.TemporaryDirectory() as folder:
        file = write_system(Path(folder), psms)
        nominal = _measure(file, seconds, homed=True)
        fast = _measure(file, seconds, homed=False, sets=(f"io.period_s={FAST_PERIOD_S}",))
    figures = {**nominal, "top_rate_hz": fast["rate_hz"]}
    conditions = {
        "boards": 2 * psms, "arms": psms, "seconds": seconds, "state": "every arm homed and holding",
        "cores": len(psutil.Process().cpu_affinity() or []), "cpu": _cpu(), "kernel": platform.release(),
        "python": platform.python_version(), "numpy": np.__version__, "bus": "emulated boards on loopback UDP",
    }
    return {"bench": "io", "figures": figures, "conditions": conditions}


def write_system(folder: Path, psms: int) -> Path:
    """A system file with so many copies of the demo's PSM, each on two boards of its own."""
    robot = yaml.safe_load((SOURCE / "io" / "PSM1-demo.yaml").read_text())
    arms = []
    for i in range(psms):
        name, copied = f"PSM{i + 1}", copy.deepcopy(robot)
        copied["robots"][0]["name"] = name
        for part in (*copied["robots"][0]["actuators"], *copied.get("digital_inputs", [])):
            part["board_id"] += 2 * i - FIRST_BOARD
        for each in copied.get("digital_inputs", []):
            each["name"] = each["name"].replace("PSM1", name)
        for chip in copied.get("dallas_chips", []):
            chip["board_id"] += 2 * i - FIRST_BOARD
            chip["name"] = chip["name"].replace("PSM1", name)
        (folder / f"io-{name}.yaml").write_text(yaml.safe_dump(copied))
        arms.append({"name": name, "type": "PSM", "serial": "demo", "IO": "IO1", "arm_file": "arms/PSM1-demo.yaml",
                     "IO_file": f"io-{name}.yaml", "PID_file": "pid/PSM.yaml"})
    system = {"$id": "dvrk-system.schema.json", "$version": "1", "IOs": [{"name": "IO1", "port": "udp"}], "arms": arms,
              "trocar": {"boards": "emulated"}}
    file = folder / "system-bench.yaml"
    file.write_text(yaml.safe_dump(system))
    return file


def _measure(file: Path, seconds: float, homed: bool, sets: tuple[str, ...] = ()) -> dict[str, Any]:
    background = Background(Request(file, f"bench-io-{os.getpid()}", "emulated", sets=sets))
    try:
        background.wait_until_up(_silent)
        if homed:
            _home_all(background.system)
        return _watch(background.system, seconds)
    finally:
        background.stop(_silent)


def _watch(system: str, seconds: float) -> dict[str, Any]:
    reader = directory.reader(system, "IO1", "state")
    try:
        _look(reader)
        first, begin, missed = int(reader.field("cycle")), reader.stamp_ns, _missed(system)
        seen = begin
        latencies, stamps = [], []
        end = monotonic_ns() + round(seconds * 1e9)
        while monotonic_ns() < end:
            pause(0.5)
            rows = reader.since(seen + 1)
            seen = int(rows[-1]["stamp_ns"]) if len(rows) else seen
            rows = rows[rows["valid"]]
            latencies.append(rows["write_ns"] - rows["recv_ns"])
            stamps.append(rows["stamp_ns"])
        if not sum(len(rows) for rows in stamps):
            raise Problem("io got no good sample from the emulated boards; is the machine busy? (trocar logs)")
        _look(reader)
        cycles, span = int(reader.field("cycle")) - first, reader.stamp_ns - begin
        latency, stamp = np.concatenate(latencies) * 1e-3, np.unique(np.concatenate(stamps))
        return {
            "read_to_write_us_p50": float(np.percentile(latency, 50)),
            "read_to_write_us_p99": float(np.percentile(latency, 99)),
            "period_us_p50": float(np.percentile(np.diff(stamp), 50)) * 1e-3,
            "period_us_p99": float(np.percentile(np.diff(stamp), 99)) * 1e-3,
            "rate_hz": cycles / span * 1e9,
            "missed_deadlines": _missed(system) - missed,
            "bad_reads": int(reader.field("bad_reads")),
            "cycles": cycles,
            "boards": len(reader.info["robots"]) * 2,
            "axes": int(reader.field("position").size),
        }
    finally:
        reader.close()


def _look(reader: RingReader) -> None:
    if not reader.newest():
        raise Problem(f"io's state cannot be read: {reader.trouble or 'it has shown none'}; see trocar logs")


def _home_all(system: str) -> None:
    problems = [f"{name}: {why}" for name, why in bring(system, arm_names(system), HOMED, 0.0, _silent).items() if why]
    if problems:
        raise Problem(f"the arms did not home: {'; '.join(problems)}")


def _missed(system: str) -> int:
    return next(life.missed for life in lives(system) if life.name == "IO1")


def _cpu() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor()


def _silent(text: str, part: float | None) -> None:
    """No progress line: a bench prints its result only."""
