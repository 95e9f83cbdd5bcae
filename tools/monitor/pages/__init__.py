"""The pages of `trocar attach`, a module each; they show the data of the modules with the same names."""
