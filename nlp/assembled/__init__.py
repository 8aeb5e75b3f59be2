"""The problem of `nlp.problem` as a program for Ipopt, evaluated without one large graph.

Nothing is built but index arrays: poses, and wrenches with their derivatives, follow the kinematic chain
(`platform`), every clearance is a function of a few local vectors (`terms`) whose derivatives the chain rule takes
to the unknowns, and all is put together where it is not zero (`problem`). `tests/test_nlp_assembled.py` holds
values, Jacobian and Hessian to those that CasADi derives from the printed problem.
"""

from pathlib import Path

from nlp.assembled.air import derive_speeds
from nlp.assembled.program import AssembledProgram, polish_with
from nlp.numbers import jets
from topo_search.model.compiled_code import refresh

refresh(derive_speeds, Path(__file__).parent, Path(jets.__file__))

__all__ = ["AssembledProgram", "polish_with"]
