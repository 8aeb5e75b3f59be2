"""The inner problem: the best angles, end-effector position and rotor inputs of one topology.

`nlp.problem` states it as the paper does; `nlp.solve` is what a search calls.
"""

from nlp.bounds import lower_bound, prove_impossible, proven_bound
from nlp.bounds.branch.arrays import centre as proof_root
from nlp.bounds.proofs import prepare_proof, prove_chunk
from nlp.solve import default_starts, hold_rod, local_optima, prepare, solve
from nlp.user_constraints import check_stated, refuse_unusable, refuse_wrong_claims

__all__ = [
    "check_stated", "default_starts", "hold_rod", "local_optima", "lower_bound", "prepare", "prepare_proof",
    "proof_root", "prove_chunk", "prove_impossible", "proven_bound", "refuse_unusable", "refuse_wrong_claims",
    "solve",
]  # fmt: skip
