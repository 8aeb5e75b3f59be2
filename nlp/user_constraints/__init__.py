"""User constraints: expressions of a platform, rows of the problem, and checks of a design.

They are not part of the printed problem: the reduced search, lower bounds and proofs ignore them. Ipopt enforces
them, and the evaluation that decides whether a point is a design checks them.
"""

from nlp.user_constraints.check import check_user_constraints, refuse_unusable, refuse_wrong_claims

__all__ = ["check_user_constraints", "refuse_unusable", "refuse_wrong_claims"]
