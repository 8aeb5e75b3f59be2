"""The inner problem: the best angles, end-effector position and rotor inputs of one topology.

`nlp.problem` writes it as the paper does; a search calls `nlp.solve`.
"""

from nlp.bounds import largest_value, lower_bound, proven_bound
from nlp.bounds.branch.arrays import centre as proof_root
from nlp.bounds.branch.proof import prepare as prepare_proof
from nlp.bounds.branch.proof import prove_chunk
from nlp.bounds.proofs import prove_impossible
from nlp.optima import local_optima
from nlp.rounding import solve_near
from nlp.solving import default_starts, move_rod, prepare, solve
from nlp.user_constraints import check_user_constraints, refuse_unusable, refuse_wrong_claims

__all__ = [
    "check_user_constraints", "default_starts", "largest_value", "local_optima", "lower_bound", "move_rod",
    "prepare", "prepare_proof", "proof_root", "prove_chunk", "prove_impossible", "proven_bound", "refuse_unusable",
    "refuse_wrong_claims", "solve", "solve_near",
]  # fmt: skip
