"""Clearances and sections of the audit, of the core and of features, and steps that features do."""

from topo_search.model.exposure import EXPOSURE_KINDS
from verify.air.bound import air, speed_residuals
from verify.assembly import assembly, rod_residuals
from verify.bare import complete, corner_residuals, power
from verify.beside_airflow import rotors_beside_airflow
from verify.brackets import beside_brackets
from verify.contacts import keep_apart
from verify.flight.analysis import flight
from verify.flight.residuals import flight_residuals
from verify.interference import interference
from verify.mesh_excess import mesh_excess
from verify.placement import placement
from verify.requirements import Scene
from verify.sections import Clearances, Section
from verify.sensitivity import sensitivity
from verify.solid_regions import beside_regions

CLEARANCES = (
    Clearances(("airflow", *EXPOSURE_KINDS, "exclusion", "separation"), lambda scene, mount: scene.requirements()),
    Clearances(("body", "rod"), keep_apart),
    Clearances(("rotor-airflow",), rotors_beside_airflow),
    Clearances(("rod-airflow",), Scene.rod),
    Clearances(("bracket-airflow", "bracket-rotor"), beside_brackets),
    Clearances(("part-region", "rod-region"), beside_regions),
)
"""All clearances, in the order of the audit."""

SECTIONS: tuple[Section, ...] = (
    Section(residuals=corner_residuals),
    Section(residuals=rod_residuals),
    Section("sensitivity", sensitivity),
    Section("flight", flight, flight_residuals),
    Section("power", power),
    Section("air", air, speed_residuals),
    Section("mesh_excess", mesh_excess),
    Section("placement", placement),
)
"""Sections of the audit, in the order of its residuals; each may use what those before it found."""

__all__ = ["CLEARANCES", "SECTIONS", "assembly", "complete", "interference"]
