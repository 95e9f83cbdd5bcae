"""An ECM: the endoscope it carries."""

from __future__ import annotations

from procs.arm.arm import Arm


class Ecm(Arm):
    """See Arm."""
