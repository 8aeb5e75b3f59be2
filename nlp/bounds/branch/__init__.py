"""Proofs by branch and bound: no design of a tree costs less than a cut, whatever its angles.

Boxes of the root orientation and the hinges are halved until a bound excludes them (`box`, with multipliers from
`multipliers`) or two modules are too close everywhere in them (`crowded`). The end-effector's position and the
rotors' inputs are convex at each point of a box and need no halving; the mass of a rod is an interval (`rod`).
Requirements that the bound leaves out can only make designs cost more: the end-effector's exclusion, exposure,
rigid parts in airflow, clearances and axis of the rod.
"""
