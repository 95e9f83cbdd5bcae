"""Becomes another program, with descriptors at 3, 4, … and LISTEN_PID in its environment: what systemd does.

    python -I -S handover.py 17,18 program arguments…

A file of its own, with the standard library alone: no program can be told its number before it has one.
"""

import fcntl
import os
import sys

FIRST = 3
HIGH = 64  # out of the way of the numbers that are wanted


def main() -> None:
    """Does not return."""
    given = [int(word) for word in sys.argv[1].split(",")]
    high = [fcntl.fcntl(number, fcntl.F_DUPFD_CLOEXEC, HIGH) for number in given]
    for number in given:
        os.close(number)
    for place, number in enumerate(high, FIRST):
        os.dup2(number, place)
    os.environ["LISTEN_PID"] = str(os.getpid())
    os.execv(sys.argv[2], sys.argv[2:])


if __name__ == "__main__":
    main()
