"""Progress of one native call in a cycle of io, in order: the rest of the cycle is done step by step."""

from typing import Final

BAD: Final = -1
"""There is no complete fresh sample."""
NONE: Final = 0
"""A sample arrived, and was not processed."""
DECODED: Final = 1
CHECKED: Final = 2
CONTROLLED: Final = 3
ENCODED: Final = 4
"""These stages have news (procs/io/stages.py); the stages after them are not done."""
READY: Final = 5
"""No stage has news; the words for the boards are ready to be sent."""
SENT: Final = 6
"""The words were sent."""
