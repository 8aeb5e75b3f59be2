"""What a point of a task misses, and how a point is made to miss nothing."""
