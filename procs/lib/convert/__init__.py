"""Configuration files from before dVRK 2.4 become today's: texts in, values out, and the fate of every key."""

from procs.lib.convert.jsonout import to_json
from procs.lib.convert.recognise import Converted, Output, convert_file
from procs.lib.convert.report import CONVERTED, DEFAULTED, DROPPED, LOST, Change

__all__ = [
    "CONVERTED", "DEFAULTED", "DROPPED", "LOST", "Change", "Converted", "Output", "convert_file", "to_json",
]
