"""The names of the environments for `gymnasium.make`. Importing this registers them."""

from __future__ import annotations

from typing import Final

import gymnasium

NAMES: Final = {"PsmReach-v0": "trocar.procs.rl.tasks:PsmReach", "PsmTrack-v0": "trocar.procs.rl.tasks:PsmTrack",
                "EcmAim-v0": "trocar.procs.rl.tasks:EcmAim", "PsmHandOver-v0": "trocar.procs.rl.hand_over:PsmHandOver",
                "PsmPush-v0": "trocar.procs.rl.push:PsmPush"}

for _name, _where in NAMES.items():
    if f"trocar/{_name}" not in gymnasium.registry:
        gymnasium.register(f"trocar/{_name}", entry_point=_where)
