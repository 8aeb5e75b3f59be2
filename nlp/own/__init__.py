"""Constraints of a user's own: as expressions of a platform, as rows of the problem, and checked on a design.

They are no part of the printed problem: the reduced search, lower bounds and proofs do not know them. Ipopt does,
and so does the evaluation that decides whether a point is a design.
"""

from nlp.own.check import check_stated, refuse_unusable
from nlp.own.invariance import refuse_wrong_claims
from nlp.own.rows import OwnConstraints, correct_point, rows_of, violations_of

__all__ = [
    "OwnConstraints", "check_stated", "correct_point", "refuse_unusable", "refuse_wrong_claims", "rows_of",
    "violations_of",
]  # fmt: skip
