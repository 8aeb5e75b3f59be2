"""The problem of `nlp.problem` evaluated without one large graph, for platforms of many modules.

Nothing is built but index arrays: poses, and wrenches with their derivatives, follow the kinematic chain (`chain`,
`balance`), every clearance is a function of a few local vectors (`carried`, `candidates`, `terms`) whose
derivatives the chain rule takes to the unknowns (`chain_rule`), and all is put together where it is not zero
(`assembly`). `tests/test_nlp_assembled.py` holds values, Jacobian and Hessian to those that
CasADi derives from the page.
"""

from nlp.assembled.program import AssembledProgram

__all__ = ["AssembledProgram"]
