"""An MTM: a master, moved by hand or held."""

from __future__ import annotations

from procs.arm.arm import Arm


class Mtm(Arm):
    """See Arm."""

    checks_tracking = False
