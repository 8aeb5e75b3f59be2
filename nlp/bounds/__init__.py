"""What no solver can change: how little effort a task takes at least, and what cannot be done at all."""

from nlp.bounds.effort import BoundBroken, bound_of, lower_bound, proven_bound
from nlp.bounds.impossible import prove_impossible

__all__ = ["BoundBroken", "bound_of", "lower_bound", "prove_impossible", "proven_bound"]
