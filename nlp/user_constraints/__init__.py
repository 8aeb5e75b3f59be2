"""User constraints: expressions of a platform, rows of the problem, and checks of a design.

They are not part of the printed problem: the reduced search, lower bounds and proofs ignore them. Ipopt enforces
them, and the evaluation that decides whether a point is a design checks them.
"""

from nlp.user_constraints.check import check_user_constraints, refuse_unusable, refuse_wrong_claims
from nlp.user_constraints.rows import UserConstraints, correct_point, rows_of, violations_of

__all__ = [
    "UserConstraints", "check_user_constraints", "correct_point", "refuse_unusable", "refuse_wrong_claims",
    "rows_of", "violations_of",
]  # fmt: skip
