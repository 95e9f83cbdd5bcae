"""Configuration: dVRK 2.4 files and our own YAML become one checked document; only this part of lib opens files."""

from procs.config.build.kinds import HEADS, Checked, check_file, kind_of
from procs.config.build.load import Loaded, load_system
from procs.config.read.problem import FileProblem
from procs.paths import PROJECT_CONFIGS

__all__ = ["HEADS", "PROJECT_CONFIGS", "Checked", "FileProblem", "Loaded", "check_file", "kind_of", "load_system"]
