"""Features of the solver: constraints beyond the printed problem, and proofs that a task is impossible.

The core imports this list, and besides it only the features that its contract in pyproject.toml lets through.
"""

from nlp.air.lazy_rows import SpeedLimits
from nlp.bounds.proofs import prove_impossible
from nlp.joints import JointLoads
from nlp.pseudo_inverse import pseudo_inverse_constraints
from nlp.rows import LazyRows
from nlp.user_constraints.rows import rows_of

LAZY_ROWS: tuple[LazyRows, ...] = (JointLoads(), SpeedLimits())
"""Limits that get rows once they matter, in the order of results."""

__all__ = ["LAZY_ROWS", "prove_impossible", "pseudo_inverse_constraints", "rows_of"]
