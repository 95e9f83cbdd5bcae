"""The most expensive stages of io, arms and boards, in C, on the same arrays as the numpy code.

Every function here does the same as the Python method with its name, which is the reference and the fallback. A table
of fields (`*_fields.py`) lists the arrays; it generates the C struct and the ctypes struct. Some functions are not such
methods: `Exchange_receive_and_check` and `Exchange_control_and_send` (procs/io/bus/exchange.py), `Kinematic_follow`
(procs/io/kinematic.py), `Pace_wait` and `Pace_sleep` (procs/node/node.py) call other functions and the operating
system in turn, and `Follow_go_on` is a whole cycle of a teleoperation (procs/teleop/steady.py).
"""
