"""`python -m tools` is the same command line as `trocar`."""

from __future__ import annotations

from procs.ended_by import ctrl_c_ends

if __name__ == "__main__":
    ctrl_c_ends()

    from tools.cli import main

    main()
