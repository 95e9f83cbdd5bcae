"""Random messages of a client: some good, most spoilt in one way or another; the same for the same seed."""

from __future__ import annotations

import json
import random
from typing import Any, Final

TOPICS: Final = ("PSM1/measured_js", "PSM1/measured_cp", "PSM1/body/jacobian", "PSM1/status", "PSM1/state", "IO1/gains",
                 "PSM1/operating_state", "IO1/PSM1/measured_js", "supervisor/state", "PSM9/state", "", "/", "../x")
COMMANDS: Final = ("move_jp", "servo_jp", "servo_cp", "servo_cf", "servo_cs", "servo_ci", "hold", "free",
                   "state_command", "jaw/move_jp", "set_base_frame", "set_tool_type", "trajectory_j/set_ratio",
                   "inverse_kinematics", "x")
OPS: Final = ("hello", "ping", "list", "commands", "read", "subscribe", "unsubscribe", "call", "get", "set", "dance", 7)
ODD: Final = (None, True, -1, 0, 1e308, -1e308, 5e-324, 10**30, "", "x", "\0", "\ud800", "é" * 70, [], {}, [[]], "NaN")


def number(draw: random.Random) -> Any:
    """A number that may be one."""
    return draw.choice([0.0, 0.1, -0.2, 1.0, draw.gauss(0, 1), draw.choice(ODD), 10.0 ** draw.randint(-300, 300)])


def message(draw: random.Random) -> bytes:
    """One message, or what is none."""
    found: dict[str, Any] = {"op": draw.choice(OPS), "id": draw.choice([1, "a", None, *ODD])}
    values = draw.choice([[number(draw) for _ in range(draw.choice([0, 1, 6, 7, 22, 64, 65]))], [0.0] * 7, [0.0] * 6])
    parts = {"topic": draw.choice(TOPICS), "rate_hz": number(draw), "of": draw.choice(["PSM1", "IO1", "x"]),
             "to": draw.choice(["PSM1", "PSM1", "PSM1", "IO1", "nobody"]), "command": draw.choice(COMMANDS),
             "values": values, "text": draw.choice(["", "disable", "resume", "x" * 65, draw.choice(ODD)]),
             "name": "fuzz", "token": "x", "property": "gain", "value": number(draw)}
    wanted = {"read": ["topic"], "subscribe": ["topic", "rate_hz"], "unsubscribe": ["topic"], "commands": ["of"],
              "call": ["to", "command", "values", "text"], "get": ["of"], "set": ["of", "property", "value"]}
    names = wanted.get(str(found["op"]), ["name"])
    found |= {name: parts[name] for name in names if draw.random() < 0.95}
    if draw.random() < 0.1:
        found[draw.choice(list(parts))] = draw.choice(ODD)
    data = json.dumps(found).encode()
    if draw.random() < 0.15:  # spoil some bytes
        spoilt = bytearray(data)
        for _ in range(draw.randint(1, 4)):
            spoilt[draw.randrange(len(spoilt))] = draw.choice(b'{}[]",:\\\x00\xff0eN')
        data = bytes(spoilt).replace(b"\n", b" ")
    return data[: draw.randrange(len(data))] if draw.random() < 0.05 else data
