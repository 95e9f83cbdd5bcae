"""What an arm does in each of its states: on the way in, and every cycle."""
