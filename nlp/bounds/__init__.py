"""Limits that no solver can beat: the least effort of a task, and proofs that it is impossible."""

from nlp.bounds.effort import BoundBroken, bound_of, lower_bound, proven_bound

__all__ = ["BoundBroken", "bound_of", "lower_bound", "proven_bound"]
