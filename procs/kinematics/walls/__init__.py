"""Where an arm may not go: shapes, the body of the arm, and the nearest place that is allowed."""
