"""Configuration: dVRK 2.4 files and our own YAML become one checked document; only this part of lib opens files."""

from procs.config.build.kinds import Checked, check_file
from procs.config.build.load import Loaded, load_system
from procs.config.read.problem import FileProblem
from procs.paths import PROJECT_CONFIGS

__all__ = ["PROJECT_CONFIGS", "Checked", "FileProblem", "Loaded", "check_file", "load_system"]
