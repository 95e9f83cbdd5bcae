"""Trusted owners of segments: our own user, root, and the one service user that TROCAR_SERVICE_USER names.

The owner of a segment controls its content, so the answer cannot come from shared memory. The supervisor sets the
variable for its processes from the configuration; a person's tools get it from the environment of the machine.
"""

from __future__ import annotations

import os
import pwd

from trocar.shm.memory.header import SegmentError

SERVICE_USER = "TROCAR_SERVICE_USER"


def accepted() -> frozenset[int]:
    """User ids whose segments may be attached; SegmentError if this machine has no such service user."""
    name = os.environ.get(SERVICE_USER, "")
    return frozenset({os.getuid(), 0} | ({_uid(name)} if name else set()))


def _uid(name: str) -> int:
    try:
        return pwd.getpwnam(name).pw_uid
    except KeyError:
        raise SegmentError(f"{SERVICE_USER}={name!r}: this machine has no such user; correct or unset it") from None


def user(uid: int) -> str:
    """A user by name, or by number when there is none."""
    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"


def users(uids: frozenset[int]) -> str:
    """Users in words."""
    return ", ".join(user(uid).removeprefix("user ") for uid in sorted(uids))

