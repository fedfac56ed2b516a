"""Start values from directions, angles, distances and heights."""
