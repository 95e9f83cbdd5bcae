"""Script interface to a running system; `trocar` provides it."""
