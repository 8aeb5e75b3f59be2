"""The power that rotors take in hover and in every load case.

| symbol | meaning | unit |
|---|---|---|
| u | squared speeds of all rotors; in hover those of least effort | rad^2/s^2 |
| P_0, P | ideal power, sum_j (k_f u_j)^1.5 / sqrt(2 rho pi R^2); shaft power, sum_j k_tau u_j^1.5 | W |
| FM | figure of merit, P_0 / P | |

Motors, controllers and wires take more than P, so that a battery lasts no longer than it says here.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from topo_search.model import CasePower, Design, Flight
from verify.residuals import clamp


def power(design: Design, measured: Flight | None) -> tuple[CasePower, ...]:
    """Return the power in hover, where the platform can hover, and in every load case."""
    return tuple(_powers(design, measured))


def _powers(design: Design, measured: Flight | None) -> Iterator[CasePower]:
    task, module, rotors = design.task, design.task.module, 4 * design.topology.n
    battery_Ws = 3600 * design.topology.n * module.battery_Wh if module.battery_Wh else None
    sums = [
        (label, float(np.sum(np.maximum(u, 0.0) ** 1.5)))
        for label, u in zip(task.case_labels, design.inputs, strict=True)
    ]
    if measured is not None and measured.hover_power_ratio is not None:
        straight_up = task.force_unit(task.n) / (rotors * module.thrust_coefficient)
        sums.insert(0, (measured.hover.name, rotors * straight_up**1.5 * measured.hover_power_ratio))
    for name, cubes in sums:
        shaft = clamp(module.torque_coefficient * cubes)
        yield CasePower(
            name=name,
            ideal_W=clamp(module.ideal_power(1.0, task.air_density) * cubes),
            shaft_W=shaft,
            figure_of_merit=clamp(module.figure_of_merit(task.air_density)),
            endurance_min=clamp(battery_Ws / shaft / 60) if battery_Ws and shaft > 0 else None,
        )
