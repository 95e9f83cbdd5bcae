"""The pages of `trocar attach`, a module each; they show what the modules of the same names read."""
