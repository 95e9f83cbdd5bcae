"""Output on terminals and in logs that are not UTF-8: each character that they lack becomes a similar one of ASCII."""

from __future__ import annotations

import codecs
import io
import sys
import unicodedata
from typing import Final

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
