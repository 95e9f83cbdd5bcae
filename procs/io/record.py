"""io's record as typed arrays: the fields of `IO_STATE`, in a ring's private record or in plain memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trocar.procs.tables.generation import next_generation
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import IO_STATE, Topic

Field: TypeAlias = Callable[[str], NDArray[Any]]
Floats: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]


def private(topic: Topic, dims: Mapping[str, int]) -> Field:
    """The fields of a private record, all zero."""
    memory: NDArray[Any] = np.zeros(1, dtype=schema_of(topic, dims).dtype)
    return lambda name: memory[name].reshape(memory[name].shape[1:])


class IoRecord:
    """Every field of the record under its own name; scalars have shape ()."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> NDArray[Any]: ...

    def __init__(self, field: Field) -> None:
        """`field(name)` gives the array of a field."""
        self.__dict__.update((row.name, field(row.name)) for row in IO_STATE.fields)

    @classmethod
    def private(cls, axes: int, robots: int, inputs: int, brakes: int = 0, outputs: int = 0) -> IoRecord:
        """A private record, all zero."""
        dims = {"axes": axes, "drives": axes + brakes, "robots": robots, "inputs": inputs, "outputs": outputs}
        return cls(private(IO_STATE, dims))

    def restart(self) -> None:
        """Clear the values of a previous process, but continue its generations: its bias and enable are over."""
        generations = self.bias_generation, self.pid_generation
        following = [[next_generation(int(one)) for one in array] for array in generations]
        for row in IO_STATE.fields:
            array = getattr(self, row.name)
            array[...] = array.dtype.type()
        for array, values in zip(generations, following, strict=True):
            array[...] = values
        self.setpoint_age_ns[...] = -1
