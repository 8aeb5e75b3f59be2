"""Features of the audit. The core imports this list and no feature."""

from __future__ import annotations

from verify.air.bound import air, speed_residuals
from verify.assembly import assembly, rod_residuals
from verify.bare import complete, corner_residuals, power
from verify.flight.analysis import flight
from verify.flight.residuals import flight_residuals
from verify.sections import Section
from verify.sensitivity import sensitivity

SECTIONS: tuple[Section, ...] = (
    Section(residuals=corner_residuals),
    Section(residuals=rod_residuals),
    Section("sensitivity", sensitivity),
    Section("flight", flight, flight_residuals),
    Section("power", power),
    Section("air", air, speed_residuals),
)
"""Sections of the audit, in the order of its residuals; each may use what those before it found."""

__all__ = ["SECTIONS", "assembly", "complete"]
