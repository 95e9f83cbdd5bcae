"""Actions of an arm in each of its states: on entry, and every cycle."""
