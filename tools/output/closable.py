"""Objects that are open until closed."""

from __future__ import annotations

from typing import Self


class Closable:
    """A context manager that is closed at its end."""

    def close(self) -> None:
        """Release all resources."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
