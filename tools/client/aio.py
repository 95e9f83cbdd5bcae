"""The methods of arms, consoles and systems as coroutines, so that other coroutines run meanwhile."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final, Self

from trocar.shm.time.clock import pause
from trocar.tools.client.moves import POLL_S, MoveHandle

AT_A_TIME: Final = 8
EVENTS_S: Final = 0.05


class AwaitedWord:
    """A method of an object, or of a part of it, by its name."""

    def __init__(self, carry_out: Callable[..., Any], path: tuple[str, ...]) -> None:
        """Made by `Aio`."""
        self._carry_out, self._path = carry_out, path

    def __getattr__(self, name: str) -> AwaitedWord:
        return AwaitedWord(self._carry_out, (*self._path, name))

    async def __call__(self, *given: Any, **named: Any) -> Any:
        """Execute it; a move ends at its goal. After a cancellation, a move and other started actions continue."""
        return await self._carry_out(self._path, given, named)


class Aio:
    """An object whose methods are awaited: `await psm.measured_cp()`, `await psm.jaw.open()`; an async context manager.

    Each call runs in a thread beside the event loop, eight at a time, so that `hold` need not wait for a `home`; each
    thread has its own object and, with `at`, its own connection.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        """Not attached yet."""
        self._make = make
        self._threads = ThreadPoolExecutor(AT_A_TIME, "trocar")
        self._own = threading.local()
        self._made: list[Any] = []
        self._is_over = threading.Event()

    def __getattr__(self, name: str) -> AwaitedWord:
        if name.startswith("_"):
            raise AttributeError(name)
        return AwaitedWord(self._carry_out, (name,))

    async def _carry_out(self, path: tuple[str, ...], given: tuple[Any, ...], named: dict[str, Any]) -> Any:
        is_cancelled = threading.Event()
        call = partial(self._call, path, given, named, is_cancelled)
        try:
            return await asyncio.get_running_loop().run_in_executor(self._threads, call)
        except asyncio.CancelledError:
            is_cancelled.set()
            raise

    def _call(self, path: tuple[str, ...], given: tuple[Any, ...], named: dict[str, Any],
              is_cancelled: threading.Event) -> Any:
        word = self._object()
        for name in path:
            word = getattr(word, name)
        result = word(*given, **named)
        if isinstance(result, MoveHandle):
            while result.is_busy() and not (is_cancelled.is_set() or self._is_over.is_set()):
                pause(POLL_S)
        return result

    def _object(self) -> Any:
        """That of this thread."""
        if not hasattr(self._own, "object"):
            self._own.object = self._make()
            self._made.append(self._own.object)
        return self._own.object

    async def events(self, *names: str) -> AsyncIterator[tuple[str, Mapping[str, Any]]]:
        """Yield each event of these names from now on, with its name, in order."""
        came: deque[tuple[str, Mapping[str, Any]]] = deque()
        loop, thread = asyncio.get_running_loop(), ThreadPoolExecutor(1, "trocar-events")
        try:
            follows = await loop.run_in_executor(thread, self._make)
            try:
                for name in names:
                    await loop.run_in_executor(
                        thread, follows.on_event, name, lambda event, name=name: came.append((name, event)))
                while True:
                    await loop.run_in_executor(thread, follows.process_events, EVENTS_S)
                    while came:
                        yield came.popleft()
            finally:
                thread.submit(follows.close)
        finally:
            thread.shutdown(wait=False)

    async def close(self) -> None:
        """Detach once running calls have returned; does not wait for moves to reach their goals."""
        self._is_over.set()
        await asyncio.get_running_loop().run_in_executor(None, self._threads.shutdown)
        for made in self._made:
            made.close()

    async def __aenter__(self) -> Self:
        """Attach; failures raise the same errors as without `aio`."""
        await asyncio.get_running_loop().run_in_executor(self._threads, self._object)
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()
