"""Constraint violations at a point of a task, and the correction of points to have none."""
