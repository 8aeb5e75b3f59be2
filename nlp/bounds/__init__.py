"""Limits that no solver can beat: the least effort, the largest value of a quantity, and impossible tasks."""

from nlp.bounds.capability import largest_value
from nlp.bounds.effort import BoundBroken, bound_of, lower_bound, proven_bound

__all__ = ["BoundBroken", "bound_of", "largest_value", "lower_bound", "proven_bound"]
