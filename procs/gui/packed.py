"""Pages and their files, kept compressed: they do not change while the process runs."""

from __future__ import annotations

import gzip
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

ONCE: Final = "no-store"
FOREVER: Final = "private, max-age=31536000, immutable"
"""For files whose address changes with their content."""


class Packed:
    """One text, sent compressed to browsers that accept it."""

    def __init__(self, text: bytes, media: str, cache: str, status: int = 200) -> None:
        self._packed, self._media, self._cache, self._status = gzip.compress(text, 6, mtime=0), media, cache, status

    async def answer(self, request: Request) -> Response:
        """The answer to a request for it."""
        headers = {"cache-control": self._cache, "vary": "accept-encoding"}
        if "gzip" in request.headers.get("accept-encoding", ""):
            headers["content-encoding"] = "gzip"
            return Response(self._packed, self._status, headers, self._media)
        return Response(gzip.decompress(self._packed), self._status, headers, self._media)
