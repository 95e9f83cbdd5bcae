"""Configuration: dVRK 2.4 files and our own YAML become one checked document; only this part of lib opens files."""

from procs.lib.config.kinds import Checked, check_file
from procs.lib.config.load import Loaded, load_system
from procs.lib.config.problem import Problem
from procs.lib.paths import PROJECT_CONFIGS

__all__ = ["PROJECT_CONFIGS", "Checked", "Loaded", "Problem", "check_file", "load_system"]
