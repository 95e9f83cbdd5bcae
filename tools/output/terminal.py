"""Output where a terminal or a stream can do less than usual: no UTF-8, no moves of the cursor, or not open at all.

Each character that a stream lacks becomes a similar one of ASCII.
"""

from __future__ import annotations

import codecs
import io
import os
import sys
import unicodedata
from typing import Final, TextIO

HANDLER: Final = "trocar.similar"
_SIMILAR: Final = {  # one character each, so that tables stay aligned
    ord(given): similar for similar, characters in {
        "-": "─━–—−‐‑", "|": "│┃", "+": "┌┐└┘├┤┬┴┼╭╮╯╰", ".": "·•", ">": "→≥", "<": "←≤", "x": "×", "u": "µμ",
        "#": "█▇▆▅▄▃▂▁", "'": "‘’", '"': "“”", "o": "°"}.items()
    for given in characters
}


def is_utf8() -> bool:
    """Whether our output takes every character."""
    return (getattr(sys.stdout, "encoding", None) or "utf-8").lower().replace("-", "").startswith("utf")


def redraws(stream: TextIO) -> bool:
    """Whether a stream is a terminal on which a line can be drawn again; one of the type `dumb` only appends."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def open_streams() -> None:
    """Open /dev/null as each standard stream that we were started without: else the next file has its number, and gets
    what is printed.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name, number in (("stdin", 0), ("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8"))


def adapt_streams() -> None:
    """Let our output and error streams write similar characters in the place of those that their encoding lacks."""
    codecs.register_error(HANDLER, _similar)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=HANDLER)


def _similar(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_ascii, error.object[error.start:error.end])), error.end


def _ascii(character: str) -> str:
    """`²` as 2, `é` as e; a question mark for what ASCII has nothing like."""
    plain = unicodedata.normalize("NFKD", character.translate(_SIMILAR)).encode("ascii", "ignore")
    return plain.decode() or "?"
