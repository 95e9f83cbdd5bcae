"""The stages of io, arms and boards that cost most, in C, over the very arrays that the numpy code works on.

Every function here does what the Python method of the same name does, which is the reference and the fallback. A table
of fields (`*_fields.py`) says which arrays those are; it makes the C struct and the one that ctypes fills. Two are no
such methods: `Exchange_answer` (procs/io/bus/exchange.py) and `Pace_wait` (procs/node/runtime.py) call others, and the
operating system, one after the other.
"""
