"""The frozen document: one system as plain values, which every process decodes with the standard library."""
