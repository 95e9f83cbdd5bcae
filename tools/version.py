"""Which Trocar this is."""

from __future__ import annotations

from trocar.procs.machine.version import VERSION as VERSION
