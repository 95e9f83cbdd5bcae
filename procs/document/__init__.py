"""The frozen document: one system as plain values, decoded by every process with the standard library."""
