r"""Upper bounds on a maximised quantity, for every platform of a size.

A design that holds a value s holds all values below, so s is less than every value at which T(s)
(`topo_search.model.maximized`) is refuted. Geometry is left out, except for the lengths of levers.

| symbol | meaning | unit |
|---|---|---|
| F_k(s), D_k | force of the wrench k that T(s) requires, F_k(0) + s D_k; its change with s | N, N / unit of s |
| nu_k | a direction for each wrench, of length at most 1 | |
| z_i | thrust axis of module i, one for its rotors | |
| n T | thrust of all rotors at their limit | N |
| W | weight of the lightest platform | N |
| o, k | largest distance of a rotor from the centroid of the modules; its drag torque over its thrust | m |
| tau | torque of a rotor about that centroid at unit thrust, abs(tau) <= o + k | m |
| d, lambda | a direction of torque; a length | , m |

**Forces.** Thrust axes cannot point along all nu_k at once: as in `nlp.bounds.wrenches`

.. math:: \sum_k \nu_k \cdot F_k(s) \le n T \max_z \sum_k \max(\nu_k \cdot z, 0)

for any nu_k, which is linear in s. The best nu_k at one s give a lower s, at which they are sought again.

**Force reserves.** Around hover the rotors' force along any nu reaches W nu_z + s abs(nu); for a disc abs(nu) is
that of its horizontal part. The mean over all nu of an elevation, and any sum of such means with shares >= 0, is a
sum over the thrust axes, each of which has the best elevation at most. That is a linear program for the shares; any
shares are valid. The sum of means is convex and homogeneous in z, so between two elevations of z it is at most the
greater value divided by the cosine of half their difference.

**Torques.** Around hover every torque s d is produced together with the weight. The sum of lambda e_z . force and
d . torque, averaged over directions d whose mean is zero, is the same about every point, as the force is the same
for all d. So

.. math:: \lambda W + s \le n T \max \left< \max(0, \lambda z_z + d \cdot \tau) \right>

For all d of the sphere the mean of max(0, a + b cos theta) grows with a >= 0 and b >= 0: for a <= b it is
(a + b)^2 / (4 b), at most (lambda + o + k)^2 / (4 (o + k)) for 0 <= lambda <= o + k. It is linear in b if
lambda = 0: s <= n T / 4 times the mean of all levers. For d = +-e_z the mean is the larger of a and
(a + abs(tau_z)) / 2, where a = lambda z_z and abs(tau_z) <= o sqrt(1 - z_z^2) + k abs(z_z), hence at most
max(lambda, sqrt((lambda + k)^2 + o^2) / 2).

The centroid is at most l_c (n - 1) from a module's centre; the mean of these distances over the modules is at most
2 l_c (n^2 - 1) / (3 n), as in a straight chain. The mean is no bound if some modules have more thrust than others.

Bounds allow for the audit's tolerance: TOLERANCE m_t g along each axis in the wrenches of reserves.
"""

import math
from functools import lru_cache

import numpy as np

from nlp.bounds.effort import heaviest_extra, lightest_task, rod_force_change, total_forces
from nlp.bounds.refutation import (
    bodies_mass,
    centre_offset,
    largest_drag,
    largest_thrust,
    longest_arm,
    tolerated_force,
    tolerated_thrust,
)
from nlp.bounds.wrenches import FORCES, largest_sum, refute_axes, refute_torque, sum_directions, sum_tolerance
from topo_search.model import Array, ResolvedTask
from topo_search.model.maximized import RESERVES, task_at, unit_of
from topo_search.model.reserves import AUDIT_TOLERANCE

ACCURACY = 1e-3
"""Relative gain under which the search for a smaller bound ends."""
MAX_STEPS = 40
"""Largest number of its steps."""
ELEVATIONS = np.radians(np.linspace(-90.0, 90.0, 91))
"""Elevations of nu that are tried."""
AXES = np.radians(np.linspace(-90.0, 90.0, 361))
"""Elevations of thrust axes between which the mean is bounded."""
LAMBDAS = np.linspace(0.0, 1.0, 101)
"""Values of lambda / (o + k) that are tried."""


@lru_cache(maxsize=32)
def largest_value(task: ResolvedTask) -> float:
    """Return a value that no design of the task's size exceeds [unit of `search.maximize`]; inf without one."""
    bounds = {"force_reserve": _bound_by_directions, "torque_reserve": _bound_by_torques}
    if (name := task.search.maximize) in RESERVES:  # `peak_input` does not limit the inputs of reserves
        task = task.with_fields("search", peak_input=1.0)
    bound = bounds.get(name or "", _bound_by_forces)(task)
    return _bound_by_rules(task, bound) * (1 + FORCES.rounding)


def _bound_by_directions(task: ResolvedTask) -> float:
    """Return a bound on the force reserve around hover [N]."""
    from scipy.optimize import linprog  # slow to load, and few commands need it

    thrust, W = largest_thrust(task), task.lightest.force_unit(task.n)
    reach = np.cos(ELEVATIONS) if task.flight.directions == "horizontal" else np.ones_like(ELEVATIONS)
    means = _mean_thrusts(ELEVATIONS[:, None], AXES[None, :])
    rows = np.column_stack([means.T, -np.ones(len(AXES))])
    cost = np.append(-W / thrust * np.sin(ELEVATIONS), 1.0)
    found = linprog(cost, rows, np.zeros(len(AXES)), np.append(reach, 0.0)[None], [1.0])
    shares = np.maximum(found.x[:-1], 0.0)
    between = math.cos((AXES[1] - AXES[0]) / 2)
    limit = thrust * float((shares @ means).max()) / between - W * float(shares @ np.sin(ELEVATIONS))
    tolerance = tolerated_thrust(task) * 2 + math.sqrt(3) * tolerated_force(task)
    missed = AUDIT_TOLERANCE * (W + heaviest_extra(task) * task.gravity)
    return (limit + tolerance * float(shares.sum())) / float(shares @ reach) + missed


def _mean_thrusts(elevation: Array, axis: Array) -> Array:
    """Return the mean of max(0, nu . z) over all nu of an elevation, for thrust axes z of another [rad]."""
    a, b = np.sin(elevation) * np.sin(axis), np.cos(elevation) * np.cos(axis)
    share = np.clip(a / np.maximum(b, np.finfo(float).tiny), -1.0, 1.0)
    inside = a * np.arccos(-share) + np.sqrt(np.maximum(b * b - a * a, 0.0))
    return np.asarray(np.where(np.abs(a) < b, inside / math.pi, np.maximum(a, 0.0)))


def _bound_by_forces(task: ResolvedTask) -> float:
    """Return a bound by sums of forces, one for each wrench of T(s)."""
    unit = unit_of(task.lightest)
    stated, double = (lightest_task(task_at(task, value)) for value in (unit, 2 * unit))
    F, rod = total_forces(stated), rod_force_change(stated)
    D, rod_D = (total_forces(double) - F) / unit, (rod_force_change(double) - rod) / unit
    F, rod = F - unit * D, rod - unit * rod_D
    k = int(np.argmax(np.linalg.norm(D, axis=1)))
    if not D[k].any():
        return math.inf
    nu, bound = np.zeros_like(D), math.inf
    nu[k] = D[k] / np.linalg.norm(D[k])
    for _ in range(MAX_STEPS):
        limit = largest_sum(stated, nu) + math.sqrt(3) * sum_tolerance(stated, nu)
        limit += FORCES.rounding * float(np.sum(np.abs(nu) * np.abs(F)))
        trial = max(_value(nu, limit, F, D), _value(nu, limit, F + rod, D + rod_D))
        if not trial < bound * (1 - ACCURACY):
            break
        bound = trial
        nu = sum_directions(stated, F + bound * D)
    return min(bound, trial)


def _value(nu: Array, limit: float, F: Array, D: Array) -> float:
    """Return the s for which sum_k nu_k . (F_k + s D_k) is the limit; inf if it does not grow with s."""
    slope = float(np.sum(nu * D))
    return max(0.0, limit - float(np.sum(nu * F))) / slope if slope > 0 else math.inf


def _bound_by_torques(task: ResolvedTask) -> float:
    """Return a bound on the torque reserve [N m]."""
    n, module, light, l_c = task.n, task.module, task.lightest, task.longest_connector
    k, W, rod, arm = largest_drag(task), light.force_unit(n), task.heaviest_rod, longest_arm(task)
    o = l_c * (n - 1) + arm
    mean = o + k if task.module_types else 2 * l_c * (n * n - 1) / (3 * n) + arm + k
    lever = task.longest_lever(n)
    com_shift = rod * (lever + (task.largest_reach(n) or 0.0) / 2) + task.end_effector.mass * lever
    com_shift = com_shift / bodies_mass(task) + centre_offset(task) + math.sqrt(3) * task.flight.com_error
    lengths = LAMBDAS * (o + k)
    torque_tolerance = module.arm_length + com_shift + lengths.max()
    tolerance = math.sqrt(3) * tolerated_force(task) * torque_tolerance
    tolerance += tolerated_thrust(task) * 2 * (o + k + lengths.max())
    tolerance += AUDIT_TOLERANCE * (W + heaviest_extra(task) * task.gravity) * module.arm_length
    yaw = np.maximum(lengths, np.hypot(lengths + k, o) / 2)
    levers = np.minimum(yaw, (lengths + o + k) ** 2 / (4 * (o + k)))
    levers[0] = min(levers[0], mean / 4)
    bounds: Array = largest_thrust(task) * levers - lengths * W
    return float(bounds.min()) + float(tolerance)


def _bound_by_rules(task: ResolvedTask, bound: float) -> float:
    """Return a bound, at most the given one, by rules on the axes of few modules and on torques."""

    def is_refuted(value: float) -> bool:
        stated = lightest_task(task_at(task, value))
        return bool(refute_axes(stated) or refute_torque(stated))

    low, high = 0.0, bound if bound < math.inf else 2.0**MAX_STEPS * unit_of(task.lightest)
    if not is_refuted(high):
        return bound
    for _ in range(2 * MAX_STEPS):
        if high - low <= ACCURACY * high or high <= 1e-9 * unit_of(task.lightest):
            break
        middle = math.sqrt(low * high) if low > 0 else high / 2
        low, high = (low, middle) if is_refuted(middle) else (middle, high)
    return high
