r"""Tabu search on exact clearances: hinges are turned until no two modules overlap.

Min-conflicts with a tabu list: pick an overlapping pair, turn a hinge on the path between its modules to the best
of some random angles, even if that is worse than before, and do not turn the same hinge again soon. This escapes
from crossings where a gradient is stuck: an envelope that pierces another one must go back the way it came. An
overlap costs a constant plus its depth, and its weight grows as long as it lasts, so that two pairs do not
alternate forever.

Modules are in preorder: hinge h turns the modules h..end[h]-1 as one rigid body, and only pairs of one of them and
another module change. All compiled code is in one file, because a compiled function is cached with its file's date
and would miss a change in another file.

| symbol | meaning | shape | unit |
|---|---|---|---|
| p, z | positions and axes of the modules; the airflow blows along -z | (n, 3) | l_arm, - |
| c, omega | point on the axis of every hinge, and its direction; for the root, its x axis | (n, 3) | l_arm, - |
| alpha | hinge angles; alpha[0] is unused | (n,) | rad |
| deficit[i, j] | required less actual clearance of a pair | (n, n) | l_arm |
| weight[i, j] | weight of the pair's deficit | (n, n) | |
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Indices


class TabuSearch(NamedTuple):
    """Settings of the search for hinge angles without overlaps."""

    hinges: int = 6
    """Number of hinges tried per turn."""
    angles: int = 24
    """Number of random angles tried per hinge: half of them anywhere, the rest near the current one."""
    spread: float = 0.5
    """Standard deviation of an angle near the current one [rad]."""
    overlap: float = 1.0
    """Constant cost of a deficit, in addition to its depth [l_arm]. Of 20 trees of 40 modules at 0.22 m the first
    start untangles 8, and 9 without it (`tests/benchmarks/untangling.py --sizes 40 --connector-distances 0.22
    --starts 1`).
    """
    straight: float = 0.02
    """Cost per radian of hinge angle, against that of a deficit [l_arm]: straight platforms lift best."""
    conflict_weight: float = 0.1
    """Increase of the weight of a pair's deficit per turn that it lasts."""
    tenure: tuple[int, int] = (3, 10)
    """Range of the tabu tenure: turns before a hinge may turn again."""
    flat: float = 1e-9
    """Value relative to its largest below which the determinant of a clearance's quadratic counts as zero."""


TABU = TabuSearch()


class PreorderTree(NamedTuple):
    """Parents of the modules, in preorder."""

    parent: Indices
    """-1 for the root."""
    end: Indices
    """The modules i..end[i]-1 are i and all outward of it."""
    sign: Array
    """Sign of the fold at a positive angle, for the hinge of module i."""


class TreePoses(NamedTuple):
    """Positions and axes of modules and hinges."""

    p: Array
    z: Array
    c: Array
    omega: Array


class Rules(NamedTuple):
    """Required clearances [l_arm] and the range of a hinge."""

    required: float
    """Clearance to reach."""
    airflow: bool
    """True if envelopes must be clear of each other."""
    balls: Array
    """Balls of a module that must be clear of another module's envelope: x, y, z, radius; shape (b, 4).

    They are invariant under quarter turns about the module's axis, which swap rotors."""
    length: float
    start_radius: float
    growth: float
    min_distance: float
    """Smallest distance of centres; -inf without a limit."""
    bolted_pairs: bool
    """True if the distance also holds for modules that share a joint."""
    turn: float
    """Largest hinge angle [rad]."""
    folds: Array
    """Ranges of allowed folds, shape (m, 2) [rad]."""


@njit(cache=True)
def tabu_search(
    tree: PreorderTree, poses: TreePoses, alpha: Array, rules: Rules, turns: int, rng: np.random.Generator
) -> float:
    """Turn hinges until no pair has a deficit; set `poses` and `alpha` to the best found and return its cost."""
    n = len(alpha)
    deficit, weight = _deficits(tree, poses, rules), np.ones((n, n))
    tabu_until = np.zeros(n, np.int64)
    min_cost, best = np.inf, alpha.copy()
    for turn in range(turns + 1):
        total = _cost(deficit)
        if total < min_cost:
            min_cost, best[:] = total, alpha
        if total == 0.0 or turn == turns:
            break
        i, j = _random_pair(deficit, rng)
        change, hinge, angle = np.inf, 0, 0.0
        for h in _hinges_between(tree, i, j, tabu_until, turn, rng):
            change_h, angle_h = _best_turn(tree, poses, alpha[h], rules, deficit, weight, h, change, rng)
            if change_h < change:
                change, hinge, angle = change_h, h, angle_h
        _turn(tree, poses, alpha, rules, deficit, hinge, angle)
        tabu_until[hinge] = turn + 1 + rng.integers(TABU.tenure[0], TABU.tenure[1])
        for i in range(n):
            for j in range(n):
                if deficit[i, j] > 0.0:
                    weight[i, j] += TABU.conflict_weight
    for hinge in range(1, n):
        _turn(tree, poses, alpha, rules, deficit, hinge, best[hinge])
    return min_cost


@njit(cache=True)
def straighten(
    tree: PreorderTree, poses: TreePoses, alpha: Array, rules: Rules, sweeps: int, rng: np.random.Generator
) -> None:
    """Turn hinges in random order, each to a smaller cost of deficits and angles."""
    deficit = _deficits(tree, poses, rules)
    weight = np.ones_like(deficit)
    for _ in range(sweeps):
        for hinge in rng.permutation(len(alpha) - 1) + 1:
            change, angle = _best_turn(tree, poses, alpha[hinge], rules, deficit, weight, hinge, 0.0, rng)
            if change < 0.0:
                _turn(tree, poses, alpha, rules, deficit, hinge, angle)


@njit(cache=True, inner=True)
def _deficits(tree: PreorderTree, poses: TreePoses, rules: Rules) -> Array:
    """Return the deficits of all pairs."""
    n = len(poses.p)
    deficit = np.zeros((n, n))
    for i in range(n):
        for j in range(i):
            deficit[i, j] = deficit[j, i] = deficit_of(rules, tree, poses, i, poses, j)
    return deficit


@njit(cache=True, inner=True)
def _cost(deficit: Array) -> float:
    """Return the unweighted cost of all deficits."""
    total = 0.0
    for i in range(len(deficit)):
        for j in range(i):
            if deficit[i, j] > 0.0:
                total += TABU.overlap + deficit[i, j]
    return total


@njit(cache=True, inner=True)
def _random_pair(deficit: Array, rng: np.random.Generator) -> tuple[int, int]:
    """Return a random pair with a deficit."""
    a, b, count = 0, 0, 0
    for i in range(len(deficit)):
        for j in range(i):
            if deficit[i, j] > 0.0:
                count += 1
                if rng.integers(0, count) == 0:
                    a, b = i, j
    return a, b


@njit(cache=True, inner=True)
def _hinges_between(
    tree: PreorderTree, i: int, j: int, tabu_until: Indices, turn: int, rng: np.random.Generator
) -> Indices:
    """Return a few random hinges on the path between two modules, preferably ones that are not tabu."""
    path = np.empty(len(tabu_until), np.int64)
    length = allowed = 0
    while i != j:
        if i > j:  # the later module in preorder is not an ancestor of the other
            h, i = i, tree.parent[i]
        else:
            h, j = j, tree.parent[j]
        path[length] = h
        if tabu_until[h] <= turn:
            path[length], path[allowed] = path[allowed], h
            allowed += 1
        length += 1
    choice = path[: allowed if allowed else length]
    rng.shuffle(choice)
    return choice[: TABU.hinges]


@njit(cache=True, inner=True)
def _best_turn(
    tree: PreorderTree,
    poses: TreePoses,
    alpha: float,
    rules: Rules,
    deficit: Array,
    weight: Array,
    hinge: int,
    to_beat: float,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Return (change of cost, angle) for the best of some random angles of a hinge.

    A trial ends once its change reaches `to_beat` or that of an earlier trial.
    """
    end = tree.end[hinge]
    pairs = _pairs_in_reach(poses, rules, deficit, hinge, end)
    cost_before = TABU.straight * abs(alpha)
    for i, j in pairs:
        if deficit[i, j] > 0.0:
            cost_before += weight[i, j] * (TABU.overlap + deficit[i, j])
    rotated = TreePoses(
        np.empty_like(poses.p), np.empty_like(poses.p), np.empty_like(poses.p), np.empty_like(poses.p)
    )
    min_change, best = to_beat, alpha
    for trial in range(TABU.angles):
        angle = rng.uniform(-rules.turn, rules.turn) if 2 * trial < TABU.angles else rng.normal(alpha, TABU.spread)
        angle = _nearest_allowed(rules.folds, tree.sign[hinge], angle)
        change = TABU.straight * abs(angle) - cost_before
        if change >= min_change:
            continue
        _rotate(poses, hinge, end, angle - alpha, rotated)
        for i, j in pairs:
            d = deficit_of(rules, tree, rotated, i, poses, j)
            if d > 0.0:
                change += weight[i, j] * (TABU.overlap + d)
                if change >= min_change:
                    break
        if change < min_change:
            min_change, best = change, angle
    return min_change, best


@njit(cache=True, inner=True)
def _nearest_allowed(folds: Array, sign: float, angle: float) -> float:
    """Return the nearest allowed angle."""
    nearest = math.inf
    for low, high in folds:
        inside = sign * min(max(sign * angle, low), high)
        if abs(inside - angle) < abs(nearest - angle):
            nearest = inside
    return nearest


@njit(cache=True, inner=True)
def _pairs_in_reach(poses: TreePoses, rules: Rules, deficit: Array, hinge: int, end: int) -> Indices:
    """Return a superset of the pairs (moved, fixed) with a deficit at some angle of the hinge, shape (m, 2).

    A ball around each envelope, or around each centre, moves about the hinge's axis at constant height and radius.
    Pairs with a deficit come first, so that bad trials end early.
    """
    n = len(poses.p)
    farthest = 0.0
    for x, y, z, radius in rules.balls:
        farthest = max(farthest, math.sqrt(x * x + y * y + z * z) + radius)
    half = rules.length / 2 if rules.airflow or farthest > 0.0 else 0.0
    reach = rules.required + max(rules.min_distance, 0.0) + 2 * half
    if half > 0.0:
        end_radius = rules.start_radius + rules.growth
        reach = max(reach, rules.required + rules.length + end_radius + max(end_radius, farthest))
    height, distance = np.empty(n), np.empty(n)
    u, v, w = poses.omega[hinge]
    for i in range(n):
        x = poses.p[i, 0] - half * poses.z[i, 0] - poses.c[hinge, 0]
        y = poses.p[i, 1] - half * poses.z[i, 1] - poses.c[hinge, 1]
        z = poses.p[i, 2] - half * poses.z[i, 2] - poses.c[hinge, 2]
        height[i] = u * x + v * y + w * z
        distance[i] = math.sqrt(max(0.0, x * x + y * y + z * z - height[i] ** 2))
    pairs = np.empty(((end - hinge) * (n - end + hinge), 2), np.int64)
    m = with_deficit = 0
    for i in range(hinge, end):
        for j in range(n):
            if hinge <= j < end or (height[i] - height[j]) ** 2 + (distance[i] - distance[j]) ** 2 >= reach**2:
                continue
            pairs[m] = i, j
            if deficit[i, j] > 0.0:
                pairs[m], pairs[with_deficit] = pairs[with_deficit].copy(), pairs[m].copy()
                with_deficit += 1
            m += 1
    return pairs[:m]


@njit(cache=True, inner=True)
def _turn(
    tree: PreorderTree, poses: TreePoses, alpha: Array, rules: Rules, deficit: Array, hinge: int, angle: float
) -> None:
    """Turn a hinge to an angle; update `poses`, `alpha` and the deficits."""
    n, end, by = len(alpha), tree.end[hinge], angle - alpha[hinge]
    _rotate(poses, hinge, end, by, poses)
    alpha[hinge] = angle
    for i in range(hinge, end):
        for j in range(n):
            if not hinge <= j < end:
                deficit[i, j] = deficit[j, i] = deficit_of(rules, tree, poses, i, poses, j)


@njit(cache=True, inner=True)
def _rotate(poses: TreePoses, first: int, end: int, angle: float, rotated: TreePoses) -> None:
    """Rotate modules and hinges first..end-1 about the hinge `first` (Rodrigues' formula); may be in place."""
    x, y, z = poses.omega[first]
    a, b, c = poses.c[first]
    s, v = math.sin(angle), 1 - math.cos(angle)
    xx, xy, xz = 1 - v * (y * y + z * z), v * x * y - s * z, v * x * z + s * y
    yx, yy, yz = v * x * y + s * z, 1 - v * (x * x + z * z), v * y * z - s * x
    zx, zy, zz = v * x * z - s * y, v * y * z + s * x, 1 - v * (x * x + y * y)
    for points, turned_points in ((poses.p, rotated.p), (poses.c, rotated.c)):
        for i in range(first, end):
            x, y, z = points[i, 0] - a, points[i, 1] - b, points[i, 2] - c
            turned_points[i, 0] = a + xx * x + xy * y + xz * z
            turned_points[i, 1] = b + yx * x + yy * y + yz * z
            turned_points[i, 2] = c + zx * x + zy * y + zz * z
    for vectors, turned_vectors in ((poses.z, rotated.z), (poses.omega, rotated.omega)):
        for i in range(first, end):
            x, y, z = vectors[i]
            turned_vectors[i, 0] = xx * x + xy * y + xz * z
            turned_vectors[i, 1] = yx * x + yy * y + yz * z
            turned_vectors[i, 2] = zx * x + zy * y + zz * z


@njit(cache=True, inner=True)
def deficit_of(rules: Rules, tree: PreorderTree, poses_i: TreePoses, i: int, poses_j: TreePoses, j: int) -> float:
    """Return the deficit of a pair, with module i in poses_i and module j in poses_j."""
    p_i, p_j = poses_i.p[i], poses_j.p[j]
    x, y, z = p_i[0] - p_j[0], p_i[1] - p_j[1], p_i[2] - p_j[2]
    smallest, bolted = rules.required, tree.parent[i] == j or tree.parent[j] == i
    if rules.bolted_pairs or not bolted:
        smallest = min(smallest, math.sqrt(x * x + y * y + z * z) - rules.min_distance)
    if rules.airflow:
        smallest = min(smallest, clearance(rules, (x, y, z), poses_i.z[i], poses_j.z[j]))
    if len(rules.balls) and not bolted:
        smallest = min(smallest, _ball_clearance(rules, poses_i, i, poses_j, j))
        smallest = min(smallest, _ball_clearance(rules, poses_j, j, poses_i, i))
    return rules.required - smallest


@njit(cache=True, inner=True)
def _ball_clearance(rules: Rules, poses_i: TreePoses, i: int, poses_j: TreePoses, j: int) -> float:
    """Return the smallest clearance of the balls of module i from the envelope of module j.

    With s along the envelope's axis and rho across it, the nearest point of the axis has
    (s - eta l) / rho = -dr / sqrt(l^2 - dr^2), clamped to its ends.
    """
    l, r, dr = rules.length, rules.start_radius, rules.growth
    x0, x1, x2 = poses_i.omega[i]
    z0, z1, z2 = poses_i.z[i]
    y0, y1, y2 = z1 * x2 - z2 * x1, z2 * x0 - z0 * x2, z0 * x1 - z1 * x0
    p_i, p_j = poses_i.p[i], poses_j.p[j]
    w0, w1, w2 = p_i[0] - p_j[0], p_i[1] - p_j[1], p_i[2] - p_j[2]
    a0, a1, a2 = poses_j.z[j]
    lean = dr / math.sqrt(l * l - dr * dr) if dr < l else math.inf
    smallest = math.inf
    for x, y, z, radius in rules.balls:
        q0, q1, q2 = w0 + x * x0 + y * y0 + z * z0, w1 + x * x1 + y * y1 + z * z1, w2 + x * x2 + y * y2 + z * z2
        s = -(q0 * a0 + q1 * a1 + q2 * a2)
        rho = math.sqrt(max(0.0, q0 * q0 + q1 * q1 + q2 * q2 - s * s))
        eta = min(max((s + lean * rho) / l, 0.0), 1.0)
        smallest = min(smallest, math.hypot(rho, s - eta * l) - r - eta * dr - radius)
    return smallest


@njit(cache=True)
def clearance(rules: Rules, w: tuple[float, float, float], z_i: Array, z_j: Array) -> float:
    """Return the clearance of two envelopes (`nlp.numbers.geometry.clearance`); infinite if clearly large enough.

    In that function's notation, f is convex along eta and along gamma, so its minimum is the stationary point, if
    that is a minimum inside the square, or on an edge.

    Args:
        rules: the envelope.
        w: p_i - p_j.
        z_i: axis of module i.
        z_j: axis of module j.
    """
    x, y, z = w
    l, r, dr = rules.length, 2 * rules.start_radius, rules.growth
    a, b, c = z_i[0] - z_j[0], z_i[1] - z_j[1], z_i[2] - z_j[2]
    reach = l + r + 2 * dr + rules.required
    if (x - l / 2 * a) ** 2 + (y - l / 2 * b) ** 2 + (z - l / 2 * c) ** 2 >= reach**2:  # between midpoints
        return math.inf
    A = l**2 - dr**2  # and B
    C = -2 * (l**2 * (z_i[0] * z_j[0] + z_i[1] * z_j[1] + z_i[2] * z_j[2]) + dr**2)
    D = -2 * (l * (z_i[0] * x + z_i[1] * y + z_i[2] * z) + r * dr)
    E = 2 * (l * (z_j[0] * x + z_j[1] * y + z_j[2] * z) - r * dr)
    det = 4 * A**2 - C**2
    inside, eta, gamma = False, 0.0, 0.0
    if det > TABU.flat * A**2:
        eta, gamma = (C * E - 2 * A * D) / det, (C * D - 2 * A * E) / det
        inside = 0.0 <= eta <= 1.0 and 0.0 <= gamma <= 1.0
    f_min = (A * eta + C * gamma + D) * eta + (A * gamma + E) * gamma if inside else math.inf
    if not inside:
        for end in (0.0, 1.0):
            free = min(max(-(C * end + D) / (2 * A), 0.0), 1.0)
            f = (A * free + C * end + D) * free + (A * end + E) * end
            if f < f_min:
                f_min, eta, gamma = f, free, end
            free = min(max(-(C * end + E) / (2 * A), 0.0), 1.0)
            f = (A * end + C * free + D) * end + (A * free + E) * free
            if f < f_min:
                f_min, eta, gamma = f, end, free
    radii = r + (eta + gamma) * dr
    return math.sqrt(max(0.0, f_min + x * x + y * y + z * z - r * r + radii * radii)) - radii
