"""Topic-table rows that every kind of process has: events, commands, their answers and outcomes."""

from __future__ import annotations

from dataclasses import dataclass

from trocar.shm.memory.rows import Field, Topic

EVENTS = Topic(
    "events",
    writer="*",
    rate_hz=0,
    depth_s=0,
    depth=1024,
    fields=(
        Field("event", "S32", "", "what happened: operating_state, goal_reached, button, status, warning, error, …"),
        Field("severity", "u1", "", "0 none, 1 status, 2 warning, 3 error"),
        Field("code", "S32", "", "of a message: a row of docs/errors.md; of others their kind (clicked, READ)"),
        Field("component", "S24", "", "robot, board, axis group or input it is about"),
        Field("axis", "<i2", "", "actuator or joint, from 0, -1: none"),
        Field("board", "<i2", "", "controller it is about, -1: none"),
        Field("value", "<f8", "", "measured value, NaN: none"),
        Field("limit", "<f8", "", "what was allowed, NaN: none"),
        Field("text", "S400", "", "one sentence for a person that says whom it is about; the log has more after …"),
        Field("hint", "S200", "", "what a person can do about it, empty: nothing in particular"),
        Field("monotonic_ns", "<i8", "ns", "CLOCK_MONOTONIC: orders events and logs of all processes"),
        Field("local_ns", "<i8", "ns", "time of day, since 1970 UTC"),
        Field("state", "S16", "", "operating state, in operating_state events"),
        Field("sub_state", "S40", "", "internal state, in operating_state events"),
        Field("is_homed", "?", "", "in operating_state events"),
        Field("is_busy", "?", "", "in operating_state events"),
    ),
)

COMMAND = Topic(
    "command",
    writer="*",
    rate_hz=0,
    depth_s=0,
    depth=32,
    fields=(
        Field("id", "<u8", "", "number of the command, unique for its client"),
        Field("origin", "<u8", "", "number of the person's command it comes from, 0: of none"),
        Field("generation", "<u8", "", "fault generation of the system when the person gave that"),
        Field("code", "<u2", "", "place of the command in the owner kind's command table"),
        Field("count", "<u2", "", "values in use"),
        Field("peer", "<u4", "", "of a bridge: which of its clients sent it, 0: the program itself"),
        Field("program", "S16", "", "program that the person gave it with"),
        Field("text", "S64", "", "text argument"),
        Field("values", "(64,)<f8", "", "numbers, in the order the command table gives; last: only `count` are copied"),
    ),
)

REPLY = Topic(
    "reply",
    writer="*",
    rate_hz=0,
    depth_s=0,
    depth=64,
    fields=(
        Field("id", "<u8", "", "number of the command answered"),
        Field("outcome", "u1", "", "1 accepted, 2 refused, 3 done, 4 failed"),
        Field("text", "S200", "", "reason, or what came of it; longer ones stand in the audit ring"),
    ),
)


@dataclass(frozen=True, slots=True)
class Reply:
    """Outcome of a command: accepted, refused, done or failed."""

    id: int
    outcome: str
    text: str


AUDIT = Topic(
    "audit",
    writer="*",
    rate_hz=0,
    depth_s=0,
    depth=256,
    fields=(
        Field("command", "S40", "", "what the instance was asked for; of a stream its first and what came of it"),
        Field("text", "S64", "", "text argument"),
        Field("outcome", "S10", "", "accepted, refused, done or failed"),
        Field("reason", "S400", "", "why, or what it found"),
        Field("origin", "<u8", "", "number of the person's command it comes from, 0: of none"),
        Field("generation", "<u8", "", "fault generation of the system when the person gave that"),
        Field("program", "S16", "", "program that the person gave it with"),
        Field("pid", "<i4", "", "process that sent it here"),
        Field("place", "u1", "", "place in the mailbox that it came through"),
        Field("peer", "<u4", "", "of a bridge: which of its clients sent it, 0: the program itself"),
        Field("id", "<u8", "", "number of the command, unique for its place"),
        Field("monotonic_ns", "<i8", "ns", "CLOCK_MONOTONIC: orders rows, events and logs of all processes"),
        Field("local_ns", "<i8", "ns", "time of day, since 1970 UTC"),
        Field("count", "u1", "", "numbers that it came with"),
        Field("values", "(64,)<f8", "", "these, in the order the command table gives; the rest is 0"),
    ),
)
