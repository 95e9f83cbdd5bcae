"""Kinematics and dynamics of the arms: chains, inverse, gravity, trajectories, poses."""
