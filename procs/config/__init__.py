"""Configuration: turns dVRK 2.4 files and our own YAML into one checked document; all such files are read here."""

from trocar.procs.config.loading.kinds import HEADS, OWN_KEYS, Checked, arm_kind, check_file, kind_of
from trocar.procs.config.loading.load import Loaded, Machine, load_system
from trocar.procs.config.read.problem import FileProblem
from trocar.procs.machine.paths import PROJECT_CONFIGS

__all__ = ["HEADS", "OWN_KEYS", "PROJECT_CONFIGS", "Checked", "FileProblem", "Loaded", "Machine", "arm_kind",
           "check_file", "kind_of", "load_system"]
