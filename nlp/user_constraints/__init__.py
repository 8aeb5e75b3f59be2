"""Constraints of a user's own: as expressions of a platform, as rows of the problem, and checked on a design.

They are no part of the printed problem: the reduced search, lower bounds and proofs do not know them. Ipopt does,
and so does the evaluation that decides whether a point is a design.
"""

from nlp.user_constraints.check import check_user_constraints, refuse_unusable, refuse_wrong_claims
from nlp.user_constraints.rows import UserConstraints, correct_point, rows_of, violations_of

__all__ = [
    "UserConstraints", "check_user_constraints", "correct_point", "refuse_unusable", "refuse_wrong_claims",
    "rows_of", "violations_of",
]  # fmt: skip
