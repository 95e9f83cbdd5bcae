"""What `trocar.rl` gives: the environments, and how one is attached to a running system."""

from __future__ import annotations

import procs.rl.registration  # noqa: F401  # their names for gymnasium.make
from procs.rl.attached import RunningSystem
from procs.rl.backend import RobotStopped
from procs.rl.environment import RobotEnv
from procs.rl.hand_over import PsmHandOver
from procs.rl.picture import PictureError
from procs.rl.push import PsmPush
from procs.rl.tasks import EcmAim, PsmReach, PsmTrack

__all__ = ["EcmAim", "PictureError", "PsmHandOver", "PsmPush", "PsmReach", "PsmTrack", "RobotEnv", "RobotStopped",
           "RunningSystem"]
