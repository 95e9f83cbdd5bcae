"""How far one call got with a cycle of io, in order: what is left of it is done step by step."""

from typing import Final

BAD: Final = -1
"""There is no complete fresh sample."""
NONE: Final = 0
"""There is one, and nothing was done with it."""
DECODED: Final = 1
CHECKED: Final = 2
CONTROLLED: Final = 3
ENCODED: Final = 4
"""These stages have news (procs/io/stages.py); what comes after is not done."""
READY: Final = 5
"""No stage has news; the words for the boards are ready to be sent."""
SENT: Final = 6
"""They were sent."""
