r"""Build errors that a design's clearances tolerate before the first violation.

| symbol | meaning |
|---|---|
| lambda | common factor on the errors |
| bound(lambda) | proven lower bound on all clearances, `verify.tolerance` |
| attained(lambda) | exact clearance of one pair with one example of such errors |

Errors up to the lambda at which the bound vanishes provably violate nothing. For an upper bound, examples are
evaluated: hinges are turned and modules shifted in the worst way for a pair to first order, and kinematics and
closed-form clearance are computed again. The pair whose bound vanishes first is evaluated first, then every pair
whose bound vanishes below the smallest violating lambda so far. That lambda is `violated_at`, and its pair is
reported; the true limit lies between the two, and the audit is `inconsistent` if they are in the wrong order.

Errors are in the frame of the module that carries the rod. All clearances that count are bounded. The mass of a
counted rod follows its length; other masses are nominal. Rotor inputs are left out because a controller adjusts
them; reserves and air speeds are those of the design as drawn.
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Limit, Module, Mount, Sensitivity, Status, WorstCase
from topo_search.model.airflow import RegionAirflow
from verify.beside_airflow import clearance as clearance_beside
from verify.bodies import AllowedCone, clearances, cone_clearance
from verify.certificate import BOUND_ROUNDING
from verify.compounds import Compound, proximities
from verify.cones import certify_parts_inside
from verify.contacts import AnyCheck
from verify.hulls import HullBody, approach
from verify.kinematics import Poses, platform, poses_of
from verify.requirements import Scene
from verify.sections import Findings
from verify.tolerance import Errors, Example, Tolerance, Weakest


class SearchSettings(NamedTuple):
    """Range and accuracy of the search for the largest errors."""

    largest_turn: float = math.pi
    """Largest angle error that is searched [rad]."""
    largest_shift: float = 1e6
    """Largest error of positions and envelopes that is searched [l_arm]."""
    largest_factor: float = 1e6
    """Largest factor on the task's tolerances that is searched."""
    accuracy: float = 1e-6
    """Relative accuracy of a tolerated error."""
    trials: int = 10
    """Largest number of factors tried to violate a pair."""
    overshoot: float = 1.05
    """Multiplier on the secant step to the next factor."""
    crossing: float = 1e-3
    """Relative accuracy of the factor at which an example starts to violate."""
    leap: float = 1.5
    """Largest ratio of successive factors; far beyond its first violation a pair may be clear again."""


SEARCH = SearchSettings()


def sensitivity(found: Findings) -> Sensitivity | None:
    """Return the build errors that a design tolerates; None without clearances, or if airflow may merge."""
    scene = found.scene
    counted = [pair for pair in zip(found.checks, found.certificates, strict=True) if pair[0].counts]
    if not counted or scene.design.task.search.interference == "parts":  # thrust lost in wakes has no bound
        return None
    search, l_arm = _ErrorSearch(found, Tolerance(scene, counted, found.sheet.mount)), scene.l_arm
    specified = scene.design.task.tolerances
    errors = Errors(math.radians(specified.hinge_angle_deg), specified.position / l_arm, specified.envelope / l_arm)
    return Sensitivity(
        hinge_angle_deg=search.limit(Errors(delta=1.0), SEARCH.largest_turn, math.degrees(1.0)),
        position_m=search.limit(Errors(delta_p=1.0), SEARCH.largest_shift, l_arm),
        envelope_m=search.limit(Errors(delta_e=1.0), SEARCH.largest_shift, l_arm),
        tolerances=search.worst_case(errors) if any(errors) else None,
    )


class _ErrorSearch:
    """Search for the largest errors that a design tolerates and the smallest that violate it."""

    def __init__(self, found: Findings, tolerance: Tolerance) -> None:
        self._found, self._mount, self._tolerance = found, found.sheet.mount, tolerance

    def limit(self, errors: Errors, largest: float, unit: float) -> Limit | None:
        """Return the largest factor on errors proven to violate nothing, times a unit; None if beyond `largest`."""
        if self._tolerance.is_clear(errors.times(largest)):
            return None
        nominal = self._tolerance.weakest(Errors())
        if nominal.bound <= BOUND_ROUNDING:
            return Limit(**_pair(nominal.check), tolerated=0.0, violated_at=0.0 if nominal.bound < 0 else None)
        low, high = 0.0, largest
        while high - low > SEARCH.accuracy * high and high > 1e-12:
            # divide by four until a lower bound is known, then bisect
            middle = 0.25 * high if low == 0.0 else (low + high) / 2
            low, high = (middle, high) if self._tolerance.is_clear(errors.times(middle)) else (low, middle)
        first, factor = self._first_violation(errors, high, largest)
        violated_at = None if factor is None else factor * unit
        return Limit(**_pair(first.check), tolerated=low * unit, violated_at=violated_at)

    def worst_case(self, errors: Errors) -> WorstCase:
        """Return the bound on all clearances within errors of a given size, and an example."""
        weakest = self._tolerance.weakest(errors)
        attained = self._example_clearance(weakest, errors)
        status = Status.CLEAR if weakest.bound > BOUND_ROUNDING else Status.UNDECIDED
        if attained < -BOUND_ROUNDING:
            status = Status.VIOLATED
        if attained < weakest.bound - BOUND_ROUNDING:
            status = Status.INCONSISTENT
        return WorstCase(
            **_pair(weakest.check),
            status=status,
            lower_m=weakest.bound * self._found.scene.l_arm,
            attained_m=attained * self._found.scene.l_arm,
            factor=self.limit(errors, SEARCH.largest_factor, 1.0),
        )

    def _first_violation(self, errors: Errors, proven: float, largest: float) -> tuple[Weakest, float | None]:
        """Return the pair with the smallest factor at which an example violates it, and that factor.

        If no example violates any pair, return the pair whose bound vanishes first, and None.
        """
        first = self._tolerance.weakest(errors.times(proven))
        smallest = self._violating_factor(first, errors, proven, largest)
        reach = min(SEARCH.leap * SEARCH.leap * proven, largest) if smallest is None else smallest
        weakest = first.check
        for candidate in self._tolerance.checks_up_to(errors.times(reach), 0.0):
            if candidate.check is weakest:
                continue
            if smallest is None:
                factor = self._violating_factor(candidate, errors, proven, largest)
            elif self._example_clearance(candidate, errors.times(smallest)) < 0:
                factor = self._crossing(candidate, errors, proven, smallest)
            else:
                continue
            if factor is not None:
                first, smallest = candidate, factor
        return first, smallest

    def _crossing(self, weakest: Weakest, errors: Errors, low: float, high: float) -> float:
        """Bisect for the factor at which an example starts to violate the pair; it does at the result."""
        while high - low > SEARCH.crossing * high:
            middle = (low + high) / 2
            violated = self._example_clearance(weakest, errors.times(middle)) < 0
            low, high = (low, middle) if violated else (middle, high)
        return high

    def _violating_factor(self, weakest: Weakest, errors: Errors, factor: float, largest: float) -> float | None:
        """Return a factor near the smallest that violates the pair, found by secant steps; None without one."""
        previous, previous_clearance = 0.0, self._example_clearance(weakest, Errors())
        for _ in range(SEARCH.trials):
            clearance = self._example_clearance(weakest, errors.times(factor))
            if clearance < 0:
                return self._crossing(weakest, errors, previous, factor)
            slope = (previous_clearance - clearance) / (factor - previous)
            step = clearance / slope if slope > 0 else factor
            previous, previous_clearance = factor, clearance
            target = factor + SEARCH.overshoot * max(step, SEARCH.accuracy * factor)
            factor = min(target, SEARCH.leap * factor, largest)
            if factor == previous:
                break
        return None

    def _example_clearance(self, weakest: Weakest, errors: Errors) -> float:
        """Return the smallest exact clearance of a pair over its examples, scaled to the errors [l_arm]."""
        l_arm, scene, distinct = self._found.scene.l_arm, self._found.scene, dict[bytes, Example]()
        for example in weakest.examples:
            scaled = Example(errors.delta * example.turns, errors.delta_p * l_arm * example.shifts)
            distinct[b"".join((x + 0.0).tobytes() for x in scaled)] = scaled  # + 0.0: no zero is negative
        scenes = (deviate(scene, *x, envelope=errors.delta_e * l_arm, mount=self._mount) for x in distinct.values())
        pairs = [self._counterpart(scene, weakest.check) for scene in scenes]
        return min((clearance_of(pair) for pair in pairs if pair is not None), default=math.inf)

    def _counterpart(self, scene: Scene, other: AnyCheck) -> AnyCheck | None:
        """Return the check that corresponds to one of another platform of the same task and tree, if any."""
        if other.kind == "airflow":  # thousands for a hundred modules, too many to search
            air = {placed[:2]: placed for placed in scene.envelopes}
            return scene.airflows_apart(air[other.a, other.segment], air[other.b, other.rotor])
        (group,) = (group for group in self._found.clearances if other.kind in group.kinds)
        return next((check for check in group.checks(scene, self._mount) if check.key == other.key), None)


def deviate(scene: Scene, turns: Array, shifts: Array, *, envelope: float, mount: Mount | None) -> Scene:
    """Return the scene of a design built with errors, in the frame of the module that carries the end-effector.

    Args:
        scene: the design as drawn.
        turns: errors of the hinge angles, shape (n-1,) [rad].
        shifts: errors of the modules' centres and of p'_E, shape (n + 1, 3) [m].
        envelope: growth of the airflow beyond its envelope [m].
        mount: the connector of the rod, on the module that no hinge moves; the root if None.
    """
    design, nominal, holder = scene.design, scene.platform.poses, 0 if mount is None else mount.module
    task = design.task
    types = tuple(_with_larger_air(kind, envelope) for kind in task.module_types)
    task = task.model_copy(update={"module": _with_larger_air(task.module, envelope), "module_types": types})
    angles = [alpha + turn for alpha, turn in zip(design.hinge_angles_rad, turns.tolist(), strict=True)]
    p_E = tuple(x + error for x, error in zip(design.end_effector_m, shifts[-1].tolist(), strict=True))
    built = design.model_copy(update={"task": task, "hinge_angles_rad": tuple(angles), "end_effector_m": p_E})
    turned = poses_of(built) if turns.any() else nominal
    R = nominal.R[holder] @ turned.R[holder].T
    p = nominal.p[holder] + (turned.p - turned.p[holder]) @ R.T
    poses = Poses(R @ turned.R, p + shifts[:-1])
    if (rod := task.end_effector.counted_rod) is not None:  # its mass follows its length
        lengths = [2 * float(np.linalg.norm(of.rod[0, 1])) for of in (scene.platform, platform(built, poses))]
        longer = task.end_effector.rod_linear_density * (lengths[1] - lengths[0])
        heavier = rod.model_copy(update={"mass": max(0.0, rod.mass + longer)})
        built = built.model_copy(update={"task": task.with_rod(heavier)})
    return Scene(built, platform(built, poses))


def _with_larger_air(module: Module, envelope: float) -> Module:
    larger = {"start_radius": module.start_radius + envelope, "reach": module.reach + envelope}
    airflow = module.airflow.model_copy(update=larger)
    if (regions := module.region_airflow) is not None:
        start, spread, reach = regions
        larger_regions = RegionAirflow(
            start_radius=start + envelope, spread_angle_deg=spread, reach=reach + envelope
        )
        airflow = airflow.model_copy(update={"regions": larger_regions})
    return module.model_copy(update={"airflow": airflow})


def clearance_of(check: AnyCheck) -> float:
    """Return the exact clearance of a check [l_arm]."""
    A, B = check.body, check.against
    if isinstance(A, Compound):
        if isinstance(B, Compound):
            return proximities([(A, B)], [check.bolted])[0].d
        return certify_parts_inside(A, B).analytic if isinstance(B, AllowedCone) else clearance_beside(check)
    if isinstance(B, AllowedCone):
        return cone_clearance(A.body, B)[0]
    return approach(A.body, B).d if isinstance(B, HullBody) else float(clearances([(A.body, B.body)]).d[0])


def _pair(check: AnyCheck) -> dict[str, object]:
    fields = ("kind", "a", "b", "segment", "contact", "rotor")
    return {field: getattr(check, field) for field in fields}
