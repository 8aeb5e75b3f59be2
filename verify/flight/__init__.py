"""Capabilities of a design beyond its task, by linear programs whose solutions are proven.

Reserves of force and torque around hover and every load case, load factors, dead rotors, the loads of joints.
"""
