r"""Tabu search on exact clearances: hinges are turned until no two modules are in each other's way.

Min-conflicts with a tabu list: take a pair that overlaps, turn a hinge on the path between its modules to the
best of some random angles, even if that is worse than before, and do not turn the same hinge again at once. It gets
out of the crossings in which a gradient is stuck: an envelope that pierces another one has to go back the way it
came. An overlap counts by itself and by its depth; pairs that overlap weigh more and more, so that no two of them
can trade for ever.

Modules are in preorder: hinge h turns the modules h..end[h]-1 as one rigid body, and only pairs of one of them and
one of the rest can change. Compiled, so loops are as fast as formulas; all in one file, because a compiled function
is cached with its file's date and would not notice a change in another one.

| symbol | meaning | shape | unit |
|---|---|---|---|
| p, z | positions and axes of the modules; the airflow blows along -z | (n, 3) | l_arm, - |
| c, omega | a point on the axis of every hinge, and its direction; of the root's, its x axis | (n, 3) | l_arm, - |
| alpha | hinge angles; alpha[0] is none | (n,) | rad |
| deficit[i, j] | by how much the pair's clearance falls short of enough | (n, n) | l_arm |
| weight[i, j] | what the pair counts | (n, n) | |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit

Indices = NDArray[np.int64]


class TabuSearch(NamedTuple):
    """The search for hinge angles at which nothing overlaps."""

    hinges: int = 6
    """Hinges tried a turn."""
    angles: int = 24
    """Random angles tried a hinge: half of them anywhere, the rest about the present one."""
    spread: float = 0.5
    """Standard deviation of an angle about the present one [rad]."""
    overlap: float = 1.0
    """Fixed cost of any deficit, besides its depth [l_arm]. Of 20 trees of 40 modules at 0.22 m the first
    start untangles 8, and 9 with 0 here (`tests/benchmarks/untangling.py --sizes 40 --connector-distances 0.22
    --starts 1`).
    """
    straight: float = 0.02
    """Cost per radian of hinge angle, against that of a deficit [l_arm]: straight platforms lift best."""
    conflict_weight: float = 0.1
    """Increase in the weight of a pair's deficit for every turn that it lasts."""
    tenure: tuple[int, int] = (3, 10)
    """Tabu tenure: turns for which a hinge rests."""
    flat: float = 1e-9
    """Share of its largest value under which the determinant of a clearance's quadratic counts as zero."""


TABU = TabuSearch()


class Tree(NamedTuple):
    """Who hangs on whom, modules in preorder."""

    parent: Indices
    """-1 for the root."""
    end: Indices
    """The modules i..end[i]-1 are i and all that hangs on it."""
    sign: Array
    """Sign of the fold, at a positive angle, of the hinge that carries module i."""


class Poses(NamedTuple):
    """Positions and axes of modules and hinges."""

    p: Array
    z: Array
    c: Array
    omega: Array


class Rules(NamedTuple):
    """Required clearances [l_arm] and the range of a hinge."""

    enough: float
    """Clearance to reach."""
    airflow: bool
    """Envelopes must be clear of each other."""
    balls: Array
    """Balls of a module that must be clear of another one's envelope: x, y, z, radius; shape (b, 4).

    They stand up to quarter turns about the module's axis, which exchange rotors."""
    length: float
    start_radius: float
    growth: float
    apart: float
    """Least distance of centres; -inf without a limit."""
    of_all: bool
    """That is asked of modules that share a joint, too."""
    turn: float
    """Largest hinge angle [rad]."""
    folds: Array
    """Folds that a hinge may have, from and to, shape (m, 2) [rad]."""


@njit(cache=True)
def tabu_search(tree: Tree, at: Poses, alpha: Array, rules: Rules, turns: int, rng: np.random.Generator) -> float:
    """Turn hinges until no pair falls short; leave `at` and `alpha` where least does; return how much."""
    n = len(alpha)
    deficit, weight = _deficits(tree, at, rules), np.ones((n, n))
    rests_until = np.zeros(n, np.int64)
    least, best = np.inf, alpha.copy()
    for turn in range(turns + 1):
        total = _cost(deficit)
        if total < least:
            least, best[:] = total, alpha
        if total == 0.0 or turn == turns:
            break
        i, j = _any_pair(deficit, rng)
        change, hinge, angle = np.inf, 0, 0.0
        for h in _hinges_between(tree, i, j, rests_until, turn, rng):
            change_h, angle_h = _best_turn(tree, at, alpha[h], rules, deficit, weight, h, change, rng)
            if change_h < change:
                change, hinge, angle = change_h, h, angle_h
        _turn(tree, at, alpha, rules, deficit, hinge, angle)
        rests_until[hinge] = turn + 1 + rng.integers(TABU.tenure[0], TABU.tenure[1])
        for i in range(n):
            for j in range(n):
                if deficit[i, j] > 0.0:
                    weight[i, j] += TABU.conflict_weight
    for hinge in range(1, n):
        _turn(tree, at, alpha, rules, deficit, hinge, best[hinge])
    return least


@njit(cache=True)
def straighten(tree: Tree, at: Poses, alpha: Array, rules: Rules, sweeps: int, rng: np.random.Generator) -> None:
    """Turn one hinge after the other where deficits and angles are less, in random order."""
    deficit = _deficits(tree, at, rules)
    weight = np.ones_like(deficit)
    for _ in range(sweeps):
        for hinge in rng.permutation(len(alpha) - 1) + 1:
            change, angle = _best_turn(tree, at, alpha[hinge], rules, deficit, weight, hinge, 0.0, rng)
            if change < 0.0:
                _turn(tree, at, alpha, rules, deficit, hinge, angle)


@njit(cache=True)
def _deficits(tree: Tree, at: Poses, rules: Rules) -> Array:
    """Return the deficits of all pairs."""
    n = len(at.p)
    deficit = np.zeros((n, n))
    for i in range(n):
        for j in range(i):
            deficit[i, j] = deficit[j, i] = deficit_of(rules, tree, at, i, at, j)
    return deficit


@njit(cache=True)
def _cost(deficit: Array) -> float:
    """Return what all deficits count together, every pair once and none for longer than another."""
    total = 0.0
    for i in range(len(deficit)):
        for j in range(i):
            if deficit[i, j] > 0.0:
                total += TABU.overlap + deficit[i, j]
    return total


@njit(cache=True)
def _any_pair(deficit: Array, rng: np.random.Generator) -> tuple[int, int]:
    """Return a random pair with a deficit."""
    a, b, seen = 0, 0, 0
    for i in range(len(deficit)):
        for j in range(i):
            if deficit[i, j] > 0.0:
                seen += 1
                if rng.integers(0, seen) == 0:
                    a, b = i, j
    return a, b


@njit(cache=True)
def _hinges_between(
    tree: Tree, i: int, j: int, rests_until: Indices, turn: int, rng: np.random.Generator
) -> Indices:
    """Return a few random hinges on the path between two modules, rested ones if there are any."""
    path = np.empty(len(rests_until), np.int64)
    length = rested = 0
    while i != j:
        if i > j:  # the later module in preorder is not above the other one
            h, i = i, tree.parent[i]
        else:
            h, j = j, tree.parent[j]
        path[length] = h
        if rests_until[h] <= turn:
            path[length], path[rested] = path[rested], h
            rested += 1
        length += 1
    choice = path[: rested if rested else length]
    rng.shuffle(choice)
    return choice[: TABU.hinges]


@njit(cache=True)
def _best_turn(
    tree: Tree,
    at: Poses,
    alpha: float,
    rules: Rules,
    deficit: Array,
    weight: Array,
    hinge: int,
    to_beat: float,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Return (change for the worse, angle) of the best of some random angles of a hinge.

    A trial ends where its change reaches `to_beat` or that of an earlier trial.
    """
    end = tree.end[hinge]
    pairs = _pairs_met(at, rules, deficit, hinge, end)
    before = TABU.straight * abs(alpha)
    for i, j in pairs:
        if deficit[i, j] > 0.0:
            before += weight[i, j] * (TABU.overlap + deficit[i, j])
    turned = Poses(np.empty_like(at.p), np.empty_like(at.p), np.empty_like(at.p), np.empty_like(at.p))
    least, best = to_beat, alpha
    for trial in range(TABU.angles):
        angle = rng.uniform(-rules.turn, rules.turn) if 2 * trial < TABU.angles else rng.normal(alpha, TABU.spread)
        angle = _nearest_allowed(rules.folds, tree.sign[hinge], angle)
        change = TABU.straight * abs(angle) - before
        if change >= least:
            continue
        _rotate(at, hinge, end, angle - alpha, turned)
        for i, j in pairs:
            short = deficit_of(rules, tree, turned, i, at, j)
            if short > 0.0:
                change += weight[i, j] * (TABU.overlap + short)
                if change >= least:
                    break
        if change < least:
            least, best = change, angle
    return least, best


@njit(cache=True)
def _nearest_allowed(folds: Array, sign: float, angle: float) -> float:
    """Return the nearest angle with an allowed fold."""
    nearest = math.inf
    for low, high in folds:
        inside = sign * min(max(sign * angle, low), high)
        if abs(inside - angle) < abs(nearest - angle):
            nearest = inside
    return nearest


@njit(cache=True)
def _pairs_met(at: Poses, rules: Rules, deficit: Array, hinge: int, end: int) -> Indices:
    """Return the pairs (moved, still) that fall short at some angle of the hinge, and maybe others, shape (m, 2).

    A ball around each envelope, or around each centre, runs round the hinge's axis at one height and one radius.
    Pairs that fall short now come first, so that bad trials end early.
    """
    n = len(at.p)
    farthest = 0.0
    for x, y, z, radius in rules.balls:
        farthest = max(farthest, math.sqrt(x * x + y * y + z * z) + radius)
    half = rules.length / 2 if rules.airflow or farthest > 0.0 else 0.0
    reach = rules.enough + max(rules.apart, 0.0) + 2 * half
    if half > 0.0:
        end_radius = rules.start_radius + rules.growth
        reach = max(reach, rules.enough + rules.length + end_radius + max(end_radius, farthest))
    height, distance = np.empty(n), np.empty(n)
    u, v, w = at.omega[hinge]
    for i in range(n):
        x = at.p[i, 0] - half * at.z[i, 0] - at.c[hinge, 0]
        y = at.p[i, 1] - half * at.z[i, 1] - at.c[hinge, 1]
        z = at.p[i, 2] - half * at.z[i, 2] - at.c[hinge, 2]
        height[i] = u * x + v * y + w * z
        distance[i] = math.sqrt(max(0.0, x * x + y * y + z * z - height[i] ** 2))
    pairs = np.empty(((end - hinge) * (n - end + hinge), 2), np.int64)
    m = short = 0
    for i in range(hinge, end):
        for j in range(n):
            if hinge <= j < end or (height[i] - height[j]) ** 2 + (distance[i] - distance[j]) ** 2 >= reach**2:
                continue
            pairs[m] = i, j
            if deficit[i, j] > 0.0:
                pairs[m], pairs[short] = pairs[short].copy(), pairs[m].copy()
                short += 1
            m += 1
    return pairs[:m]


@njit(cache=True)
def _turn(tree: Tree, at: Poses, alpha: Array, rules: Rules, deficit: Array, hinge: int, angle: float) -> None:
    """Turn a hinge to an angle; `at`, `alpha` and the deficits follow."""
    n, end, by = len(alpha), tree.end[hinge], angle - alpha[hinge]
    _rotate(at, hinge, end, by, at)
    alpha[hinge] = angle
    for i in range(hinge, end):
        for j in range(n):
            if not hinge <= j < end:
                deficit[i, j] = deficit[j, i] = deficit_of(rules, tree, at, i, at, j)


@njit(cache=True)
def _rotate(at: Poses, first: int, end: int, angle: float, turned: Poses) -> None:
    """Rotate modules and hinges first..end-1 about the hinge `first` (Rodrigues' formula), in place if need be."""
    x, y, z = at.omega[first]
    a, b, c = at.c[first]
    s, v = math.sin(angle), 1 - math.cos(angle)
    xx, xy, xz = 1 - v * (y * y + z * z), v * x * y - s * z, v * x * z + s * y
    yx, yy, yz = v * x * y + s * z, 1 - v * (x * x + z * z), v * y * z - s * x
    zx, zy, zz = v * x * z - s * y, v * y * z + s * x, 1 - v * (x * x + y * y)
    for points, turned_points in ((at.p, turned.p), (at.c, turned.c)):
        for i in range(first, end):
            x, y, z = points[i, 0] - a, points[i, 1] - b, points[i, 2] - c
            turned_points[i, 0] = a + xx * x + xy * y + xz * z
            turned_points[i, 1] = b + yx * x + yy * y + yz * z
            turned_points[i, 2] = c + zx * x + zy * y + zz * z
    for vectors, turned_vectors in ((at.z, turned.z), (at.omega, turned.omega)):
        for i in range(first, end):
            x, y, z = vectors[i]
            turned_vectors[i, 0] = xx * x + xy * y + xz * z
            turned_vectors[i, 1] = yx * x + yy * y + yz * z
            turned_vectors[i, 2] = zx * x + zy * y + zz * z


@njit(cache=True)
def deficit_of(rules: Rules, tree: Tree, of_i: Poses, i: int, of_j: Poses, j: int) -> float:
    """Return by how much the clearance of a pair falls short of enough; module i of some poses, j of others."""
    p_i, p_j = of_i.p[i], of_j.p[j]
    x, y, z = p_i[0] - p_j[0], p_i[1] - p_j[1], p_i[2] - p_j[2]
    least, bolted = rules.enough, tree.parent[i] == j or tree.parent[j] == i
    if rules.of_all or not bolted:
        least = min(least, math.sqrt(x * x + y * y + z * z) - rules.apart)
    if rules.airflow:
        least = min(least, clearance(rules, (x, y, z), of_i.z[i], of_j.z[j]))
    if len(rules.balls) and not bolted:
        least = min(least, _balls_beside(rules, of_i, i, of_j, j), _balls_beside(rules, of_j, j, of_i, i))
    return rules.enough - least


@njit(cache=True)
def _balls_beside(rules: Rules, of_i: Poses, i: int, of_j: Poses, j: int) -> float:
    """Return the least clearance of the balls of module i from the envelope of module j, or more than enough.

    With s along the envelope's axis and rho across it, a point of the axis is nearest where
    (s - eta l) / rho = -dr / sqrt(l^2 - dr^2), up to its ends.
    """
    l, r, dr = rules.length, rules.start_radius, rules.growth
    x0, x1, x2 = of_i.omega[i]
    z0, z1, z2 = of_i.z[i]
    y0, y1, y2 = z1 * x2 - z2 * x1, z2 * x0 - z0 * x2, z0 * x1 - z1 * x0
    w0, w1, w2 = of_i.p[i, 0] - of_j.p[j, 0], of_i.p[i, 1] - of_j.p[j, 1], of_i.p[i, 2] - of_j.p[j, 2]
    a0, a1, a2 = of_j.z[j]
    lean = dr / math.sqrt(l * l - dr * dr) if dr < l else math.inf
    least = math.inf
    for x, y, z, radius in rules.balls:
        q0, q1, q2 = w0 + x * x0 + y * y0 + z * z0, w1 + x * x1 + y * y1 + z * z1, w2 + x * x2 + y * y2 + z * z2
        s = -(q0 * a0 + q1 * a1 + q2 * a2)
        rho = math.sqrt(max(0.0, q0 * q0 + q1 * q1 + q2 * q2 - s * s))
        eta = min(max((s + lean * rho) / l, 0.0), 1.0)
        least = min(least, math.hypot(rho, s - eta * l) - r - eta * dr - radius)
    return least


@njit(cache=True)
def clearance(rules: Rules, w: tuple[float, float, float], z_i: Array, z_j: Array) -> float:
    """Return the clearance of two envelopes (`nlp.numbers.geometry.clearance`); infinite if at once seen as enough.

    With the letters of that function: f is convex along eta and along gamma, so that it is least at its stationary
    point, if that is a minimum inside the square, or else on an edge.

    Args:
        rules: the envelope.
        w: p_i - p_j.
        z_i: axis of module i.
        z_j: axis of module j.
    """
    x, y, z = w
    l, r, dr = rules.length, 2 * rules.start_radius, rules.growth
    a, b, c = z_i[0] - z_j[0], z_i[1] - z_j[1], z_i[2] - z_j[2]
    reach = l + r + 2 * dr + rules.enough
    if (x - l / 2 * a) ** 2 + (y - l / 2 * b) ** 2 + (z - l / 2 * c) ** 2 >= reach**2:  # from midpoint to midpoint
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
    least = (A * eta + C * gamma + D) * eta + (A * gamma + E) * gamma if inside else math.inf
    if not inside:
        for end in (0.0, 1.0):
            between = min(max(-(C * end + D) / (2 * A), 0.0), 1.0)
            f = (A * between + C * end + D) * between + (A * end + E) * end
            if f < least:
                least, eta, gamma = f, between, end
            between = min(max(-(C * end + E) / (2 * A), 0.0), 1.0)
            f = (A * end + C * between + D) * end + (A * between + E) * between
            if f < least:
                least, eta, gamma = f, end, between
    radii = r + (eta + gamma) * dr
    return math.sqrt(max(0.0, least + x * x + y * y + z * z - r * r + radii * radii)) - radii
