"""Recordings driven again: commands at their instants, setpoints streamed, records shown to tools."""
