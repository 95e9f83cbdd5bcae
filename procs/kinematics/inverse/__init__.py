"""Inverse kinematics: joints for a pose of the tip, for every kind of arm."""
