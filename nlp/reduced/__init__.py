"""The problem of `nlp.problem` in the space of angles and end-effector alone: many cheap starts, compiled.

The rotor inputs are eliminated by their dual (`inputs`), clearances are exact (`clearance`), and a descent on the
augmented Lagrangian (`merit`, `descent`) leads from every start (`draws`) to an end. The best distinct ends
(`search`) lie next to designs, which Ipopt makes exact (`polish`). `tests/test_nlp_reduced.py` holds values and
derivatives to the page. `nlp.solve` does not begin with it yet: hulls and hinges with several ranges are missing,
and the search before a tree counts as infeasible takes too long for tasks with many infeasible trees.

A compiled function is cached with its own file's date: after a change in one of these files delete the caches.
"""
