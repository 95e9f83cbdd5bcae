"""Contents of `trocar.rl`: the environments, and the attachment of one to a running system."""

from __future__ import annotations

import trocar.procs.rl.registration  # noqa: F401  # their names for gymnasium.make
from trocar.procs.rl.attached import RunningSystem
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.environment import RobotEnv
from trocar.procs.rl.hand_over import PsmHandOver
from trocar.procs.rl.picture import PictureError
from trocar.procs.rl.push import PsmPush
from trocar.procs.rl.tasks import EcmAim, PsmReach, PsmTrack

__all__ = ["EcmAim", "PictureError", "PsmHandOver", "PsmPush", "PsmReach", "PsmTrack", "RobotEnv", "RobotStopped",
           "RunningSystem"]
