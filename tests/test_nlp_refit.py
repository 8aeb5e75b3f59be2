"""Inputs found again for given angles: least, within limits, and as good as those that a search found."""

import math

import numpy as np
import pytest
from export_cases import random_design
from scipy.optimize import minimize

from nlp.refit import NotPossible, refit
from topo_search.model import Design, Status, Topology
from verify import audit
from verify.kinematics import platform, wrench_map


def test_the_same_angles_give_the_same_design(solved_push: Design) -> None:
    again = refit(solved_push, solved_push.hinge_angles_rad)
    assert again.objective == pytest.approx(solved_push.objective, rel=1e-8)
    np.testing.assert_allclose(again.inputs, solved_push.inputs, atol=1e-5 * solved_push.task.max_input)


def test_inputs_of_other_angles_are_the_least_that_do_the_task(solved_push: Design) -> None:
    angles = np.add(solved_push.hinge_angles_rad, [0.02, -0.01, 0.01, -0.02])
    found = refit(solved_push, angles)
    assert audit(found).residuals[0].scaled < 1e-9
    A = wrench_map(platform(found), found.task.module) * found.task.max_input
    for u in found.inputs:
        v = u.ravel() / found.task.max_input
        other = minimize(
            lambda x: (x @ x / 2, x),
            np.full(v.shape, 0.5),
            jac=True,
            bounds=[(0, 1)] * len(v),
            constraints={
                "type": "eq",
                "fun": lambda x, v=v: A @ (x - v),
                "jac": lambda x: A,
            },
            options={"ftol": 1e-14, "maxiter": 500},
            method="SLSQP",
        )
        assert other.success
        assert v @ v / 2 <= other.fun * (1 + 1e-6)
        assert v.min() >= 0
        assert v.max() <= 1


def test_what_rotors_cannot_do_is_named(solved_push: Design) -> None:
    with pytest.raises(NotPossible, match="load case 0 cannot be produced"):
        refit(solved_push, [0.0] * 4)  # level rotors do not push sideways


def test_an_end_effector_fixed_from_the_centre_of_mass_stays_there() -> None:
    task = {"end_effector": {"position": [0.5, 0.1, 0.0]}, "module": {"max_thrust_to_weight": 20.0}}
    design = random_design(Topology.from_key("a10"), 5, task).model_copy(
        update={"root_orientation_rad": (0.0, 0.0, 0.0)}
    )
    np.testing.assert_allclose(platform(refit(design, [0.0])).p_e, [0.5, 0.1, 0.0], atol=1e-12)


def test_rotors_that_never_stop_keep_their_least_input(solved_push: Design) -> None:
    module = solved_push.task.module.model_copy(update={"min_input": 0.002})
    asked = solved_push.model_copy(update={"task": solved_push.task.model_copy(update={"module": module})})
    assert solved_push.inputs.min() < asked.task.min_input
    angles = [math.radians(0.5 * round(math.degrees(alpha) / 0.5)) for alpha in asked.hinge_angles_rad]
    found = refit(asked, angles)
    assert found.inputs.min() >= asked.task.min_input * (1 - 1e-9)
    assert all(row.status is Status.CLEAR for row in audit(found).residuals)
    assert found.objective >= refit(solved_push, angles).objective
