"""What stands in the place of something that has been closed."""

from __future__ import annotations

from typing import Any, NoReturn

from trocar.tools.output.errors import Disconnected


class _Closed:
    """Whatever is wanted of it is an error."""

    def __init__(self, what: str) -> None:
        self._what = what

    def close(self) -> None:
        """It is."""

    def __getattr__(self, name: str) -> NoReturn:
        raise Disconnected(f"{self._what} is closed; make it again")


def closed(what: str) -> Any:
    """In the place of a part of `what`: Disconnected says that it is closed."""
    return _Closed(what)
