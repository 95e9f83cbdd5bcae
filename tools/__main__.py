"""`python -m tools` is the same command line as `trocar`."""

from __future__ import annotations

from tools.cli import main

if __name__ == "__main__":
    main()
