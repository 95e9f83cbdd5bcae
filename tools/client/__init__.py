"""What scripts see of a running system; `trocar` gives it."""
