"""Which Trocar this is."""

from __future__ import annotations

from procs.version import VERSION as VERSION
