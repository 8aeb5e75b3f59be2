"""The problem of `nlp.problem` as a program for Ipopt, evaluated without one large expression graph.

Only index arrays are built. Poses, and wrenches with their derivatives, follow the kinematic chain (`platform`).
Every clearance is a function of a few local vectors (`terms`, `kkt_candidates`), whose derivatives the chain rule
converts to those by the unknowns (`chain_rule`). `problem` assembles the nonzero entries.
`tests/test_nlp_assembled.py` compares values, Jacobian and Hessian with those that CasADi derives from the printed
problem.
"""

from pathlib import Path

from nlp.assembled.chain_rule import slopes
from nlp.symbols import clearance
from topo_search.compiled_code import refresh

refresh(slopes, Path(__file__).parent, Path(clearance.__file__))
