"""The problem of `nlp.problem` evaluated without one large graph, for platforms of many modules.

Nothing is built but index arrays: poses and their derivatives follow the kinematic chain (`chain`), every clearance
is a function of three local vectors at most (`carried`, `terms`), and the derivatives are put together where
they are not zero (`assembly`). `tests/test_nlp_assembled.py` holds values, Jacobian and Hessian to those that
CasADi derives from the page.
"""

from nlp.assembled.program import AssembledProgram

__all__ = ["AssembledProgram"]
