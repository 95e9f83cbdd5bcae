"""What scripts see of a running system; `trocar.py` is the door to it."""
