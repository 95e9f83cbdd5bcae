"""Programs that take the place of an operator or of an arm."""
