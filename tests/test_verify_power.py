"""Power in hover and in load cases, against blade tips and stream tubes by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from topo_search.model import Design
from topo_search.model.files import read_json
from verify import audit
from verify.kinematics import platform, wrench_map

DESIGN = Path(__file__).parent / "designs" / "wall-push.json"


def least_cubes(A: NDArray[np.float64], wrench: NDArray[np.float64], limit: float) -> float:
    """The least sum of cubed speeds, by another solver."""
    unit = np.abs(A).max(axis=1) * limit

    def powers(v: NDArray[np.float64]) -> float:
        return float(np.sum(np.maximum(v, 0.0) ** 1.5))

    M, m = A * limit / unit[:, None], wrench / unit
    equations = {"type": "eq", "fun": lambda v: M @ v - m, "jac": lambda _: M}
    found = minimize(
        powers,
        np.full(12, 0.3),
        jac=lambda v: 1.5 * np.sqrt(np.maximum(v, 0.0)),
        bounds=[(0.0, 1.0)] * 12,
        constraints=[equations],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 1000},
    )
    return limit**1.5 * float(found.fun)


def test_power_is_drag_torque_times_speed_and_ideal_power_that_of_a_stream_tube() -> None:
    stated = read_json(Design, DESIGN)
    module = stated.task.module.model_copy(update={"battery_Wh": 20.0})
    design = stated.model_copy(update={"task": stated.task.model_copy(update={"module": module})})
    found = audit(design)
    assert [case.name for case in found.power] == ["hover", *design.task.case_labels]
    A = wrench_map(platform(design), module)
    for case, u in zip(found.power[1:], design.inputs.reshape(-1, 12), strict=True):
        speeds, thrusts = np.sqrt(u), module.thrust_coefficient * u
        # far below its disc a stream tube has half the area and twice the speed: T = 2 rho A v^2, P = T v
        v = np.sqrt(thrusts / (2 * 1.2 * math.pi * module.body.rotor_radius**2))
        assert case.ideal_W == pytest.approx(float(thrusts @ v), rel=1e-12)
        assert case.shaft_W == pytest.approx(float(module.torque_coefficient * u @ speeds), rel=1e-12)
        assert case.figure_of_merit == pytest.approx(case.ideal_W / case.shaft_W)
    loads = np.array([0.0, 0.0, design.task.force_unit(3), 0.0, 0.0, 0.0]), *(A @ design.inputs.reshape(-1, 12).T).T
    for case, load in zip(found.power, loads, strict=True):
        least_W = module.torque_coefficient * least_cubes(A, load, module.max_input(9.81))
        assert case.endurance_min == pytest.approx(60 * 3 * 20.0 / least_W, rel=1e-6)
        assert case.endurance_min > 60 * 3 * 20.0 / case.shaft_W  # the least effort takes more than the least power
    hover, flight = found.power[0], found.flight
    straight = design.task.force_unit(3) / 12 / module.thrust_coefficient
    least = 12 * module.torque_coefficient * straight**1.5
    assert hover.shaft_W == pytest.approx(flight.hover_power_ratio * least)
    assert hover.shaft_W > least
