"""THE TABLE of faults: number, code, severity, what io does, what happened and what a person can do about it.

The number travels in `fault` of io's record (0: none), the code in events. Numbers are never reused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

WARNING: Final = 2
ERROR: Final = 3

NOTHING: Final = 0
STOP: Final = 1  # joint controller off, zero current
POWER_OFF: Final = 2  # and amplifiers and motor power off
CUT: Final = 3  # and the safety relays opened

JOINT: Final = "joint"
SENDER: Final = "ADDRESS:PORT"  # in the text of a row: who it was


@dataclass(frozen=True, slots=True)
class Fault:
    """One row: `text` says what is wrong in one sentence, `hint` what a person can do.

    `unit` of the value and limit that come with it: JOINT is rad or m as the axis is; empty: they come with none.
    `bound` says what the limit is.
    """

    number: int
    code: str
    severity: int
    action: int  # NOTHING, STOP, POWER_OFF or CUT
    text: str
    hint: str
    unit: str = ""
    bound: str = "allowed"


BAD_READS: Final = Fault(
    1, "bad-reads", ERROR, POWER_OFF, "no good sample from the controllers within the watchdog time",
    "check the cable and the controllers' supply, then power on and home", "s")
READ_MISSED: Final = Fault(
    2, "read-missed", WARNING, NOTHING, "a read of the controllers failed; the last output is kept",
    "once in a while is harmless; often means a bad cable, or a controller in trouble", "s")
CURRENT: Final = Fault(
    3, "current", ERROR, POWER_OFF, "measured motor current above its limit for more than 100 cycles",
    "look for a blocked joint or a wrong current calibration", "A")
SAFETY_AMP_DISABLE: Final = Fault(
    4, "safety-amp-disable", ERROR, POWER_OFF, "the controller cut an amplifier: measured and requested current differ",
    "check the motor cable and the current calibration, then power on")
TEMPERATURE: Final = Fault(
    5, "temperature", ERROR, POWER_OFF, "amplifier too hot",
    "let the controller cool down, check its fans and the load", "°C")
TEMPERATURE_HIGH: Final = Fault(
    6, "temperature-high", WARNING, NOTHING, "amplifier getting hot", "lower the load or improve the cooling", "°C")
POTENTIOMETER: Final = Fault(
    7, "potentiometer", ERROR, POWER_OFF, "potentiometer and encoder disagree for longer than tolerated",
    "home again; if it returns, check the potentiometer, its calibration and the tolerance in the IO file", JOINT)
ENCODER_OVERFLOW: Final = Fault(
    8, "encoder-overflow", ERROR, POWER_OFF, "encoder counter overflow",
    "power on, bias and home again; check the encoder")
POWER_LOST: Final = Fault(
    9, "power-lost", ERROR, POWER_OFF, "motor power went off unexpectedly",
    "check the emergency stop and the safety chain, then power on and home")
POWER_TIMEOUT: Final = Fault(
    10, "power-timeout", ERROR, POWER_OFF, "motor power did not come on in 3 s",
    "check the emergency stop, the safety chain and the controllers' supply")
POWER_FAULT: Final = Fault(
    11, "power-fault", ERROR, POWER_OFF, "a controller reports a motor supply fault", "check the controllers' supply")
WATCHDOG: Final = Fault(
    12, "watchdog", ERROR, POWER_OFF, "a controller's watchdog has cut the amplifiers",
    "power on and home; if it returns, see the missed deadlines in trocar status")
AMPLIFIER: Final = Fault(
    13, "amplifier", ERROR, POWER_OFF, "an amplifier is off although it should be on",
    "check the motor cable; a short circuit or overheating makes an amplifier fail")
TRACKING: Final = Fault(
    14, "tracking", ERROR, STOP, "the joint controller cannot follow its set-point",
    "look for a collision or a too fast command; the tolerance is in the PID file", JOINT)
NOT_FINITE: Final = Fault(
    15, "not-finite", ERROR, STOP, "a set-point or a requested current was not a finite number",
    "a program sent NaN or infinity; nothing of it reached the motors")
ARM_LOST: Final = Fault(
    16, "arm-lost", ERROR, NOTHING, "the arm's process has sent no set-points for too long; holding",
    "see why the arm's process does not come back (trocar status); power off if in doubt", "s")
ARM_LOST_POWER_OFF: Final = Fault(
    17, "arm-lost-power-off", ERROR, POWER_OFF, "the arm's process stayed away; power was switched off",
    "restart the arm, power on and home", "s")
BIAS_FAILED: Final = Fault(
    18, "bias-failed", ERROR, NOTHING, "an encoder did not take the value it was set to",
    "try again; if it returns, look at the potentiometers' values", JOINT, "set to")
POT_MISSING: Final = Fault(
    20, "pot-missing", ERROR, CUT, "a potentiometer reads where its table has no position; relays were opened",
    "check that the table belongs to this arm, and the arm's cable; move the joint by hand and try again")
SHARED_BOARD: Final = Fault(
    19, "shared-board", ERROR, POWER_OFF, "another robot on the same controller had a fault; power was switched off",
    "see the other robot's fault")
CURRENT_ERROR: Final = Fault(
    21, "current-error", ERROR, POWER_OFF, "measured and requested motor current differ for longer than tolerated",
    "check motor, motor cable and current calibration; the tolerance is io.current_error_a and _s", "A")
CALIBRATION_MODE: Final = Fault(
    22, "calibration-mode", WARNING, NOTHING, "calibration mode: potentiometers are not compared with encoders",
    "for calibrating only; without calibration_mode the checks are back")
CALIBRATION_MOTORS: Final = Fault(
    23, "calibration-motors", WARNING, NOTHING, "in calibration mode the motor amplifiers of a dRA1 stay off",
    "its brakes can be released, the arm moved by hand; without calibration_mode the motors are switched on")
PERIOD: Final = Fault(
    24, "period", ERROR, STOP, "the I/O loop took more than twice its period on average over a second",
    "the computer is too slow or too busy: see trocar status, docs/operating.md (real time), io.period_s", "s")
PERIOD_LONG: Final = Fault(
    25, "period-long", WARNING, NOTHING, "an I/O cycle works longer than its period on average over a second",
    "the computer is too slow or too busy: see trocar status, docs/operating.md (real time), io.period_s", "s")
FOREIGN_DATAGRAMS: Final = Fault(
    26, "foreign-datagrams", WARNING, NOTHING, f"datagrams from {SENDER} are ignored: no controller is there",
    "find the program that sends them; on a network of their own nobody else reaches io or the controllers")
BOARD_AWAY: Final = Fault(
    27, "board-away", ERROR, POWER_OFF, "the controller has left the bus: it has no power, or its cable is out",
    "check its supply and its cables; the other controllers are not affected; then power on and home")
TASK_OVER_BUDGET: Final = Fault(
    31, "task-over-budget", ERROR, NOTHING, "an in-cycle task was too slow and was detached",
    "shorten its step or raise its budget_us (docs/in-cycle.md)")
TASK_FAILED: Final = Fault(
    32, "task-failed", ERROR, NOTHING, "an in-cycle task failed and was detached",
    "mend its module and start again (docs/in-cycle.md)")

FAULTS: Final = (
    BAD_READS, READ_MISSED, CURRENT, SAFETY_AMP_DISABLE, TEMPERATURE, TEMPERATURE_HIGH, POTENTIOMETER, ENCODER_OVERFLOW,
    POWER_LOST, POWER_TIMEOUT, POWER_FAULT, WATCHDOG, AMPLIFIER, TRACKING, NOT_FINITE, ARM_LOST, ARM_LOST_POWER_OFF,
    BIAS_FAILED, SHARED_BOARD, POT_MISSING, CURRENT_ERROR, CALIBRATION_MODE,
    CALIBRATION_MOTORS, PERIOD, PERIOD_LONG, FOREIGN_DATAGRAMS, BOARD_AWAY, TASK_OVER_BUDGET,
    TASK_FAILED,
)


@dataclass(frozen=True, slots=True)
class FaultReport:
    """One fault as it is told: a sentence about whom it is and what happened, and the same as data. Empty code: none.

    Axes count from 0; -1 and NaN: there is none. `hint` is what a person can do about it.
    """

    code: str = ""
    text: str = ""
    axis: int = -1
    board: int = -1
    value: float = math.nan
    limit: float = math.nan
    hint: str = ""

    @property
    def words(self) -> str:
        """What happened, and the hint."""
        return f"{self.text}; {self.hint}" if self.hint else self.text


NO_FAULT: Final = FaultReport()


def reported(number: int) -> FaultReport:
    """What the table alone says of a latched fault."""
    fault = fault_of(number)
    if fault is None:
        return FaultReport("io-fault", f"io reports fault {number}")
    return FaultReport(fault.code, fault.text, hint=fault.hint)


def fault_of(number: int) -> Fault | None:
    """The row of a fault number; None for 0 and for numbers nobody knows."""
    return next((row for row in FAULTS if row.number == number), None)
