"""The problem of `nlp.problem` in the space of angles and end-effector alone: many cheap starts, compiled.

The rotor inputs are eliminated by their dual (`inputs`), clearances are exact (`clearance`), and a descent on the
augmented Lagrangian (`merit`, `descent`) leads from every draw (`draws`) to an end. The best distinct ends
(`search`) lie next to designs, which Ipopt makes exact (`starts`). `tests/test_nlp_reduced.py` holds values and
derivatives to the printed problem. `expressed` says for which tasks all this stands.
"""
