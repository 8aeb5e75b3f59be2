"""Flight capability of a design beyond its task, by linear programs with proven solutions.

Reserves of force and torque in hover and every load case, load factors, rotor failures, joint loads.
"""
