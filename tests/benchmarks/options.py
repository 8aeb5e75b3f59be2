"""Options of a benchmark run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Options:
    """Sizes and limits; each part has default sizes."""

    sizes: tuple[int, ...]
    topologies: int = 10
    """Uniformly drawn topologies of each size."""
    starts: int = 5
    """Starts of each topology."""
    cap: int = 600
    """Largest CPU time of one measurement [s]."""
    seconds: float = 600.0
    """CPU time of each method in the part `five` [s]."""
    distances: tuple[float, ...] = ()
    """Connector distances [m]; empty: the default of the part."""
    examples: tuple[str, ...] = ()
    """Tasks of the part `share`; empty: its default."""
    direct_up_to: int = 40
    """Largest size for which the direct formulation is measured in the part `growth`."""


AIRFLOW_ALONE = "search.body_clearance=false"
"""The paper's clearances: only airflow keeps modules apart."""


def at(distance: float) -> str:
    """Return the `FIELD=VALUE` setting of a connector distance [m]."""
    return f"module.connector_distance={distance}"
