"""io's record as typed arrays: the fields of `IO_STATE`, in a ring's private record or in plain memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

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

    def __init__(self, field: Field) -> None:
        """`field(name)` gives the array of a field."""
        self.valid, self.age_ns, self.cycle = field("valid"), field("age_ns"), field("cycle")
        self.read_ns, self.recv_ns, self.write_ns = field("read_ns"), field("recv_ns"), field("write_ns")
        self.bad_reads = field("bad_reads")
        self.position: Floats = field("position")
        self.velocity: Floats = field("velocity")
        self.firmware_velocity: Floats = field("firmware_velocity")
        self.software_velocity: Floats = field("software_velocity")
        self.acceleration: Floats = field("acceleration")
        self.effort: Floats = field("effort")
        self.setpoint_position: Floats = field("setpoint_position")
        self.setpoint_velocity: Floats = field("setpoint_velocity")
        self.setpoint_effort: Floats = field("setpoint_effort")
        self.position_error: Floats = field("position_error")
        self.disturbance: Floats = field("disturbance")
        self.pot_position: Floats = field("pot_position")
        self.pot_voltage: Floats = field("pot_voltage")
        self.pot_bits: NDArray[np.uint16] = field("pot_bits")
        self.current: Floats = field("current")
        self.current_request: Floats = field("current_request")
        self.temperature: Floats = field("temperature")
        self.encoder_bits: NDArray[np.int32] = field("encoder_bits")
        self.amp_enabled: Flags = field("amp_enabled")
        self.amp_on: Flags = field("amp_on")
        self.effort_mode: Flags = field("effort_mode")
        self.at_limit: Flags = field("at_limit")
        self.encoder_set: Flags = field("encoder_set")
        self.power_requested: Flags = field("power_requested")
        self.powered: Flags = field("powered")
        self.amps_on: Flags = field("amps_on")
        self.watchdog: Flags = field("watchdog")
        self.power_fault: Flags = field("power_fault")
        self.relay: Flags = field("relay")
        self.biased: Flags = field("biased")
        self.biasing: Flags = field("biasing")
        self.bias_generation: NDArray[np.uint32] = field("bias_generation")
        self.brakes_released: Flags = field("brakes_released")
        self.pot_check: Flags = field("pot_check")
        self.pid_enabled: Flags = field("pid_enabled")
        self.pid_generation: NDArray[np.uint32] = field("pid_generation")
        self.limits_enforced: Flags = field("limits_enforced")
        self.tracking_check: Flags = field("tracking_check")
        self.use_setpoint_velocity: Flags = field("use_setpoint_velocity")
        self.holding: Flags = field("holding")
        self.setpoint_age_ns: NDArray[np.int64] = field("setpoint_age_ns")
        self.fault: NDArray[np.uint16] = field("fault")
        self.desired_generation: NDArray[np.uint32] = field("desired_generation")
        self.desired_void: Flags = field("desired_void")
        self.desired_refused: NDArray[np.bytes_] = field("desired_refused")
        self.calibration_mode = field("calibration_mode")
        self.simulated: Flags = field("simulated")
        self.robot_valid: Flags = field("robot_valid")
        self.sample_age_ns: NDArray[np.int64] = field("sample_age_ns")
        self.board_period: Floats = field("board_period")
        self.input: Flags = field("input")
        self.output: Flags = field("output")
        self._all = [field(f.name) for f in IO_STATE.fields]

    @classmethod
    def private(cls, axes: int, robots: int, inputs: int, brakes: int = 0, outputs: int = 0) -> IoRecord:
        """A private record, all zero."""
        dims = {"axes": axes, "drives": axes + brakes, "robots": robots, "inputs": inputs, "outputs": outputs}
        return cls(private(IO_STATE, dims))

    def restart(self) -> None:
        """Clear the values of a previous process, but continue its generations: its bias and enable are over."""
        bias, pid = self.bias_generation + 1, self.pid_generation + 1
        for array in self._all:
            array[...] = array.dtype.type()
        self.bias_generation[...], self.pid_generation[...] = bias, pid
        self.setpoint_age_ns[...] = -1
