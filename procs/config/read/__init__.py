"""Texts of configuration files as plain values with the line of every key, and where files are looked for."""
