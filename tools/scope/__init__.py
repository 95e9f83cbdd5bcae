"""`trocar scope`: a window of a robot's records around a moment, at full rate."""
