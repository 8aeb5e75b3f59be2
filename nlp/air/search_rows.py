"""Limits on air speed as arrays for the compiled search."""

import math
from typing import NamedTuple

import numpy as np

from nlp.air.fastest import TARGET_SHARE, region_of
from nlp.air.jets import JetConstants, SpeedRegion, jet_of
from topo_search.model import Array, Indices, ResolvedTask


class Speeds(NamedTuple):
    """The rows of air speeds, one per load case of the task, region and module; they follow the clearances.

    Each region is a `nlp.air.jets.SpeedRegion`, whose axis may follow p_E.
    """

    jet: JetConstants
    case: Indices
    module: Indices
    region: Indices
    start: Array
    """Shape (r, 3)."""
    axis: Array
    """Shape (r, 3)."""
    along: Array
    """Length of a path along p_E, -1 for a cone with its axis to the COM, else 0; shape (r,)."""
    radius: Array
    half_angle: Array
    within: Array
    over: Array
    """Reciprocal of the limit, shape (r,) [s/m]."""
    planes: Array
    """Planes of all regions, shape (f, 3)."""
    first: Indices
    """First plane of each region, then the number of planes, shape (r + 1,)."""

    @property
    def lower(self) -> list[float]:
        """Lower bound of every row."""
        return [-math.log(TARGET_SHARE)] * len(self.case)


def speeds_of(task: ResolvedTask) -> Speeds | None:
    """Return the rows of a task's limits on air speed; None without any."""
    l_arm, regions, along, over = task.module.arm_length, list[SpeedRegion](), list[float](), list[float]()
    for exposure in task.exposure:
        if exposure.speed is None:
            continue
        for shape in exposure.shapes:
            region = region_of(shape.at(np.array([0.0, 0.0, 1.0])), l_arm, exposure.speed_reach)
            regions.append(region)
            # the axis follows the platform
            along.append(float(region.axis[2]) if shape.takes_direction_from_com else 0.0)
            over.append(1 / exposure.speed)
    if not regions:
        return None
    case, region, module = (
        index.ravel() for index in np.indices((len(task.declared.load_cases), len(regions), task.n))
    )
    axes = np.array([r.axis for r in regions]).reshape(-1, 3) * (np.array(along) == 0.0)[:, None]
    return Speeds(
        jet_of(task.module, task.air_density, task.gravity),
        case,
        module,
        region,
        np.array([r.start for r in regions]).reshape(-1, 3),
        axes,
        np.array(along),
        np.array([r.radius for r in regions]),
        np.array([r.half_angle for r in regions]),
        np.array([r.within for r in regions]),
        np.array(over),
        np.concatenate([np.empty((0, 3)), *(r.planes for r in regions)]),
        np.cumsum([0, *(len(r.planes) for r in regions)]),
    )
