r"""Errors that the clearances of a design tolerate before the first violation.

| symbol | meaning |
|---|---|
| lambda | factor by which some errors grow together |
| bound(lambda) | proven lower bound of all clearances, `verify.tolerance` |
| attained(lambda) | exact clearance of one pair with one example of such errors |

Errors up to the lambda at which the bound vanishes violate nothing: proven. Pairs are tried out: hinges are turned
and modules are shifted the worst way for a pair to first order, and kinematics and closed-form clearance are
evaluated again. The pair whose bound vanishes first is tried first, then every pair whose bound is gone by the
least lambda that violates any so far. That least lambda is `violated_at`, and its pair is named: the truth lies
between.

Masses are taken as stated. Rotor inputs are left out, for a controller adjusts them, and so are real parts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from topo_search.model import Design, Limit, Sensitivity, Status, WorstCase
from topo_search.model.module import RegionAirflow
from verify.bodies import Array, Cone, clearances, cone_clearance
from verify.certificate import BOUND_ROUNDING
from verify.hulls import Hull, approach
from verify.kinematics import Poses, platform, poses_of
from verify.requirements import Requirement, Scene
from verify.tolerance import KINDS, Errors, Tolerance, Weakest


class SearchSettings(NamedTuple):
    """How far and how closely errors are looked for."""

    largest_turn: float = math.pi
    """Larger errors of angles are not looked for [rad]."""
    largest_shift: float = 1e6
    """Larger errors of positions and envelopes are not looked for [l_arm]."""
    largest_factor: float = 1e6
    """Larger factors of the tolerances are not looked for."""
    accuracy: float = 1e-6
    """A largest error is found to this part of itself."""
    trials: int = 10
    """Largest number of error sizes that are tried for one that violates a pair."""
    overshoot: float = 1.05
    """Factor on the expected step to the next size."""
    crossing: float = 1e-3
    """The factor at which an example begins to violate is found to this part of itself."""
    leap: float = 1.5
    """Largest ratio of one size to the one before: far beyond the first violation a pair may be clear again."""


SEARCH = SearchSettings()


def sensitivity(scene: Scene, requirements: Sequence[Requirement], holder: int) -> Sensitivity | None:
    """Return how much error a design tolerates; None if there is no clearance to lose, or parts decide.

    Args:
        scene: the design with its volumes.
        requirements: what is asked of them; those that do not count are left out.
        holder: the module that carries the end-effector.
    """
    bounded = [r for r in requirements if r.counts and r.kind in KINDS]
    if not bounded or scene.design.task.search.interference == "parts":  # of parts beside airflow there is no bound
        return None
    tolerance, l_arm, stated = Tolerance(scene, bounded, holder), scene.l_arm, scene.design.task.tolerances
    errors = Errors(math.radians(stated.hinge_angle_deg), stated.position / l_arm, stated.envelope / l_arm)
    return Sensitivity(
        hinge_angle_deg=_limit(tolerance, Errors(delta=1.0), SEARCH.largest_turn, math.degrees(1.0)),
        position_m=_limit(tolerance, Errors(delta_p=1.0), SEARCH.largest_shift, l_arm),
        envelope_m=_limit(tolerance, Errors(delta_e=1.0), SEARCH.largest_shift, l_arm),
        tolerances=_worst_case(tolerance, errors) if any(errors) else None,
    )


def _limit(tolerance: Tolerance, errors: Errors, largest: float, unit: float) -> Limit | None:
    """Return the largest factor of some errors that is proven to violate nothing, times a unit.

    None if the largest that is looked for violates nothing either.
    """
    if tolerance.keeps(errors.times(largest)):
        return None
    nominal = tolerance.weakest(Errors())
    if nominal.bound <= BOUND_ROUNDING:
        return Limit(**_pair(nominal.requirement), tolerated=0.0, violated_at=0.0 if nominal.bound < 0 else None)
    low, high = 0.0, largest
    while high - low > SEARCH.accuracy * high and high > 1e-12:
        # quarter the range of sizes first, then halve what is left
        middle = 0.25 * high if low == 0.0 else (low + high) / 2
        low, high = (middle, high) if tolerance.keeps(errors.times(middle)) else (low, middle)
    first, violating = _first_to_break(tolerance, errors, high, largest)
    at = None if violating is None else violating * unit
    return Limit(**_pair(first.requirement), tolerated=low * unit, violated_at=at)


def _worst_case(tolerance: Tolerance, errors: Errors) -> WorstCase:
    """Return what errors of some size do."""
    weakest = tolerance.weakest(errors)
    attained = _least_clearance(tolerance, weakest, errors)
    status = Status.CLEAR if weakest.bound > BOUND_ROUNDING else Status.UNDECIDED
    return WorstCase(
        **_pair(weakest.requirement),
        status=Status.VIOLATED if attained < -BOUND_ROUNDING else status,
        lower_m=weakest.bound * tolerance.scene.l_arm,
        attained_m=attained * tolerance.scene.l_arm,
        factor=_limit(tolerance, errors, SEARCH.largest_factor, 1.0),
    )


def _first_to_break(
    tolerance: Tolerance, errors: Errors, proven: float, largest: float
) -> tuple[Weakest, float | None]:
    """Return the pair with the least factor at which an example violates it, and that factor.

    None, and the pair whose bound vanishes first, if no example violates any.
    """
    first = tolerance.weakest(errors.times(proven))
    least = _violating_factor(tolerance, first, errors, proven, largest)
    reach = min(SEARCH.leap * SEARCH.leap * proven, largest) if least is None else least
    nearest = first.requirement
    for other in tolerance.pairs_up_to(errors.times(reach), 0.0):
        if other.requirement is nearest:
            continue
        if least is None:
            factor = _violating_factor(tolerance, other, errors, proven, largest)
        elif _least_clearance(tolerance, other, errors.times(least)) < 0:
            factor = _crossing(tolerance, other, errors, proven, least)
        else:
            continue
        if factor is not None:
            first, least = other, factor
    return first, least


def _crossing(tolerance: Tolerance, weakest: Weakest, errors: Errors, low: float, high: float) -> float:
    """Return a factor at which an example violates the pair, and just below which none does."""
    while high - low > SEARCH.crossing * high:
        middle = (low + high) / 2
        violated = _least_clearance(tolerance, weakest, errors.times(middle)) < 0
        low, high = (low, middle) if violated else (middle, high)
    return high


def _violating_factor(
    tolerance: Tolerance, weakest: Weakest, errors: Errors, factor: float, largest: float
) -> float | None:
    """Return a factor near the least at which an example violates the pair; None if none is found."""
    before, left_before = 0.0, _least_clearance(tolerance, weakest, Errors())
    for _ in range(SEARCH.trials):
        left = _least_clearance(tolerance, weakest, errors.times(factor))
        if left < 0:
            return _crossing(tolerance, weakest, errors, before, factor)
        slope = (left_before - left) / (factor - before)
        step = left / slope if slope > 0 else factor
        before, left_before = factor, left
        beyond = factor + SEARCH.overshoot * max(step, SEARCH.accuracy * factor)
        factor = min(beyond, SEARCH.leap * factor, largest)
        if factor == before:
            break
    return None


def _least_clearance(tolerance: Tolerance, weakest: Weakest, errors: Errors) -> float:
    """Return the least exact clearance that an example leaves its pair [l_arm]."""
    l_arm = tolerance.scene.l_arm
    scenes = (
        deviate(
            tolerance.scene.design,
            turns=errors.delta * example.turns,
            shifts=errors.delta_p * l_arm * example.shifts,
            tip=errors.delta_p * l_arm * example.tip,
            envelope=errors.delta_e * l_arm,
            holder=tolerance.holder,
        )
        for example in weakest.examples
    )
    return min(clearance_of(scene.counterpart(weakest.requirement)) for scene in scenes)


def deviate(design: Design, *, turns: Array, shifts: Array, tip: Array, envelope: float, holder: int) -> Scene:
    """Return the volumes of a design that is built with errors, seen from the module that carries the end-effector.

    Args:
        design: the design.
        turns: errors of the hinge angles, shape (n-1,) [rad].
        shifts: errors of the modules' centres, shape (n, 3) [m].
        tip: error of p'_E, shape (3,) [m].
        envelope: how far the airflow reaches beyond its envelope [m].
        holder: that module; no hinge moves it.
    """
    module = design.task.module
    wider = {"start_radius": module.start_radius + envelope, "reach": module.reach + envelope}
    airflow = module.airflow.model_copy(update=wider)
    if (regions := module.region_airflow) is not None:
        start, spread, reach = regions
        wide = RegionAirflow(start_radius=start + envelope, spread_angle_deg=spread, reach=reach + envelope)
        airflow = airflow.model_copy(update={"regions": wide})
    task = design.task.model_copy(update={"module": module.model_copy(update={"airflow": airflow})})
    angles = [alpha + turn for alpha, turn in zip(design.hinge_angles_rad, turns.tolist(), strict=True)]
    p_E = tuple(x + error for x, error in zip(design.end_effector_m, tip.tolist(), strict=True))
    built = design.model_copy(update={"task": task, "hinge_angles_rad": tuple(angles), "end_effector_m": p_E})
    nominal, turned = poses_of(design), poses_of(built)
    R = nominal.R[holder] @ turned.R[holder].T
    p = nominal.p[holder] + (turned.p - turned.p[holder]) @ R.T
    return Scene(built, platform(built, Poses(R @ turned.R, p + shifts)))


def clearance_of(requirement: Requirement) -> float:
    """Return the exact clearance of a requirement from its closed form [l_arm]."""
    if isinstance(requirement.against, Cone):
        return cone_clearance(requirement.body.body, requirement.against)[0]
    if isinstance(requirement.against, Hull):
        return approach(requirement.body.body, requirement.against).d
    return float(clearances([(requirement.body.body, requirement.against.body)]).d[0])


def _pair(requirement: Requirement) -> dict[str, object]:
    return {"kind": requirement.kind, "a": requirement.a, "b": requirement.b, "segment": requirement.segment}
