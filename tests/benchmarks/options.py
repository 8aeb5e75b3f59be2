"""What a run of the benchmark measures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Options:
    """Sizes and limits; every part has its own default sizes."""

    sizes: tuple[int, ...]
    topologies: int = 10
    """Uniformly drawn topologies of each size."""
    starts: int = 5
    """Starts of each topology."""
    cap: int = 600
    """Most CPU seconds of one measurement."""
    seconds: float = 600.0
    """CPU seconds of each method in the part `five`."""
    distances: tuple[float, ...] = ()
    """Connector distances [m]; every part has its own default."""
    examples: tuple[str, ...] = ()
    """Tasks of the part `share`; it has its own default."""
    direct_up_to: int = 40
    """Largest size whose growth is measured for the direct formulation too."""


AIRFLOW_ALONE = "search.body_clearance=false"
"""The paper's clearances: nothing but airflow keeps modules apart."""


def at(distance: float) -> str:
    """Return the setting of a connector distance [m]."""
    return f"module.connector_distance={distance}"
