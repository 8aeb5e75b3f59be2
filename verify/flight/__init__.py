"""Capabilities of a design beyond its task, by linear programs whose solutions are proven.

Reserves of force and torque around hover and every load case, load factors, dead rotors, the loads of joints.
"""

from __future__ import annotations

from verify.flight.measured import flight
from verify.flight.residuals import failure_residuals, load_residuals, reserve_residuals, tolerance_residuals
from verify.flight.vehicle import capability

__all__ = [
    "capability",
    "failure_residuals",
    "flight",
    "load_residuals",
    "reserve_residuals",
    "tolerance_residuals",
]
