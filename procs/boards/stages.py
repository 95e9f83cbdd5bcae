"""Who does the stages of a cycle that work on all axes at once: the kernel, else numpy, to the same bits."""

from __future__ import annotations

from collections.abc import Callable

from procs.kernel.bound import BoundStruct
from procs.kernel.fields import CStruct
from procs.kernel.library import bind


def chosen(table: CStruct, source: object) -> tuple[Callable[..., int], ...]:
    """The functions of `table`, in its order, for `source`: else its methods of these names."""
    bound = bind(table, source)
    return tuple(bound.function(name) if isinstance(bound, BoundStruct) else getattr(source, name)
                 for name in table.functions)
