"""Configuration files from before dVRK 2.4 become today's: texts in, values out, and the outcome of every key."""

from trocar.tools.converters.differences import differences
from trocar.tools.converters.jsonout import to_json
from trocar.tools.converters.recognise import Converted, Output, convert_file
from trocar.tools.converters.report import CONVERTED, DEFAULTED, DROPPED, LOST, Change, Reference

__all__ = [
    "CONVERTED", "DEFAULTED", "DROPPED", "LOST", "Change", "Converted", "Output", "Reference", "convert_file",
    "differences", "to_json",
]
