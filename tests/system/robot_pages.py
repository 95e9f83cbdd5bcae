"""A system with something for every page of robots: an endoscope arm, its focus, pedals, and a KINEMATIC cart."""

from __future__ import annotations

import json
from pathlib import Path

FOCUS = ("endoscope_focus_in", "endoscope_focus_out")


def system_file(place: Path) -> Path:
    """Written to a folder; what it names is in `configs`."""
    rows = [{"name": name, "board_id": 3, "bit_id": bit, "is_PWM": False} for bit, name in enumerate(FOCUS)]
    (place / "focus.json").write_text(
        json.dumps({"$id": "saw-robot-io.schema.json", "$version": "6", "digital_outputs": rows}))
    carried = [{"name": name, "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml",
                "base_frame": {"component": "SUJ", "interface": name}} for name in ("PSM1", "PSM2", "PSM3")]
    file = place / "pages.json"
    file.write_text(json.dumps({
        "$id": "dvrk-system.schema.json", "$version": "1",
        "IOs": [{"name": "IO1", "port": "udp"}],
        "arms": [{"name": "ECM", "type": "ECM", "serial": "demo", "IO": "IO1", "arm_file": "arms/ECM-demo.yaml",
                  "IO_file": "io/ECM-demo.yaml", "PID_file": "pid/ECM.yaml",
                  "base_frame": {"component": "SUJ", "interface": "ECM"}},
                 {"name": "SUJ", "type": "SUJ_Classic", "simulation": "KINEMATIC",
                  "arm_file": "arms/SUJ-kinematic.yaml"}, *carried],
        "consoles": [{"name": "console", "input_type": "PEDALS_ONLY",
                      "IO_pedals": {"IO": "IO1", "IO_file": "io/pedals-demo.yaml"}}],
        "ISI_focus_controller": {"name": "lens", "IO": "IO1", "IO_file": "focus.json"}}))
    return file


OPTIONS = ("--boards", "emulated", "--set", "io.period_s=0.002", "--set", "arm.period_s=0.002", "--set", "io.spin_us=0")
