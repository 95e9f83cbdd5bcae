"""Topic-table rows that every kind of process has: events, commands, their answers and outcomes."""

from __future__ import annotations

from dataclasses import dataclass

from trocar.shm.memory.rows import Field, Topic

EVENTS = Topic("events", writer="*", depth=1024, fields=(
    Field("event", "S32", "", "what happened: operating_state, goal_reached, button, status, warning, error, …"),
    Field("severity", "u1", "", "0 none, 1 status, 2 warning, 3 error"),
    Field("code", "S32", "", "of messages: a row of docs/errors.md; else the kind (clicked, READ)"),
    Field("component", "S24", "", "robot, board, axis group or input it is about"),
    Field("axis", "<i2", "", "actuator or joint, from 0, -1: none"),
    Field("board", "<i2", "", "controller it is about, -1: none"),
    Field("value", "<f8", "", "measured value, NaN: none"),
    Field("limit", "<f8", "", "what was allowed, NaN: none"),
    Field("text", "S400", "", "one sentence that names its component; if it ends in …, the log has the rest"),
    Field("hint", "S200", "", "remedy, empty: none in particular"),
    Field("monotonic_ns", "<i8", "ns", "CLOCK_MONOTONIC: orders events and logs of all processes"),
    Field("local_ns", "<i8", "ns", "time of day, since 1970 UTC"),
    Field("state", "S16", "", "operating state, in operating_state events"),
    Field("sub_state", "S40", "", "internal state, in operating_state events"),
    Field("is_homed", "?", "", "in operating_state events"),
    Field("is_busy", "?", "", "in operating_state events"),
))

COMMAND = Topic("command", writer="*", depth=32, fields=(
    Field("id", "<u8", "", "number of the command, unique for its client"),
    Field("origin", "<u8", "", "number of the operator's command that caused it, 0: none"),
    Field("generation", "<u8", "", "fault generation of the system at that command"),
    Field("code", "<u2", "", "index in the command table of the receiving kind of process"),
    Field("count", "<u2", "", "values in use"),
    Field("peer", "<u4", "", "of a bridge: which of its clients sent it, 0: the program itself"),
    Field("program", "S16", "", "program that sent that command"),
    Field("text", "S64", "", "text argument"),
    Field("values", "(64,)<f8", "", "numbers, in the order of the command table; only the first `count` are valid"),
))

REPLY = Topic("reply", writer="*", depth=64, fields=(
    Field("id", "<u8", "", "number of the command answered"),
    Field("outcome", "u1", "", "1 accepted, 2 refused, 3 done, 4 failed"),
    Field("text", "S200", "", "reason or result; longer ones are in the audit ring"),
))


@dataclass(frozen=True, slots=True)
class Reply:
    """Outcome of a command: accepted, refused, done or failed."""

    id: int
    outcome: str
    text: str


AUDIT = Topic("audit", writer="*", depth=256, fields=(
    Field("command", "S40", "", "command to the instance; of a stream, only the first one and the outcome"),
    Field("text", "S64", "", "text argument"),
    Field("outcome", "S10", "", "accepted, refused, done or failed"),
    Field("reason", "S400", "", "reason or result"),
    Field("origin", "<u8", "", "number of the operator's command that caused it, 0: none"),
    Field("generation", "<u8", "", "fault generation of the system at that command"),
    Field("program", "S16", "", "program that sent that command"),
    Field("sender", "S60", "", "program that sent it here, on behalf of `program`"),
    Field("pid", "<i4", "", "process that sent it here"),
    Field("place", "u1", "", "place in the mailbox that it came through"),
    Field("peer", "<u4", "", "of a bridge: which of its clients sent it, 0: the program itself"),
    Field("id", "<u8", "", "number of the command, unique for its place"),
    Field("monotonic_ns", "<i8", "ns", "CLOCK_MONOTONIC: orders rows, events and logs of all processes"),
    Field("local_ns", "<i8", "ns", "time of day, since 1970 UTC"),
    Field("count", "u1", "", "numbers that it came with"),
    Field("values", "(64,)<f8", "", "these numbers, in the order of the command table; the rest is 0"),
))
