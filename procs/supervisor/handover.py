"""Replace this process by a program with descriptors at 3, 4, … and LISTEN_PID in its environment, like systemd.

    python -I -S handover.py 17,18 program arguments…

A separate file that uses the standard library only: the process id is known only after the process has started.
"""

import fcntl
import os
import sys

FIRST = 3
HIGH = 64  # above all target numbers


def main() -> None:
    """Move the descriptors and execute the program; does not return."""
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
