"""Command lines for use in messages, and the name of a system that is started without one."""

from __future__ import annotations

import os
import pwd
import re
from typing import Final

FIRST_USER: Final = 1000
"""The user id that Linux gives to the first person; smaller ones are those of root and of services."""
REMEDY: Final = "trocar "
"""An error text that contains this names the command to type, and needs no other remedy."""


def default_system(usual: str = "trocar") -> str:
    """The name of a system without `--system`: `usual`, with the user's name behind it except for root, services and
    the machine's first user, so that systems of several people have different names.
    """
    number = os.getuid()
    if number <= FIRST_USER:
        return usual
    try:
        user = pwd.getpwuid(number).pw_name
    except KeyError:
        user = str(number)
    return f"{usual}-{re.sub('[^A-Za-z0-9_-]', '_', user)}"[:40]


def verb_line(words: str, system: str) -> str:
    """`trocar WORDS` for a system, with its name unless that is the default."""
    return f"trocar {words}" if system == default_system() else f"trocar {words} --system {system}"
