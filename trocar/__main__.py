"""`python -m trocar` is the same command line as `trocar`."""

from __future__ import annotations

from trocar.procs.machine.end_signals import ctrl_c_ends

if __name__ == "__main__":
    ctrl_c_ends()

    from trocar.tools.cli import main

    main()
