"""The same as numbers, exactly: poses, clearances, points of the problem and what they violate."""
