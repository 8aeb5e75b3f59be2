"""Symmetry of a task: which trees have the same optimum, and why.

A task has a mirror symmetry if an improper isometry maps all of its requirements onto themselves.

| symbol | meaning | shape |
|---|---|---|
| O | improper isometry, det O = -1: force -> O f, torque -> -O tau | (3, 3) |
| P = -O | equivalent rotation: force -> -P f, torque -> P tau | (3, 3) |
| f_E, f_C | force at the end-effector and at the COM | (3,) |
| tau | sum of both torques of a load case: a torque has no point of action | (3,) |
| p_E | end-effector from the COM, if the task fixes it | (3,) |
| V | corners of a convex target region, unordered | (k, 3) |

The mirror image of a platform is a platform of the same family: that of a module is the module with two opposite
ports exchanged and the same spin pattern, if its rotors allow that (a mirror in a plane along the thrust axis
exchanges rotors and reverses all spins). Its tree is the axis mirror of the tree. So if O maps the task onto
itself, both trees have the same optimum.

Two independent vectors and their images determine a rotation. If all vectors of the task are on one line, rotations
about it do not matter, and two rotations per image suffice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Flags, LoadCase, Module, ResolvedTask
from topo_search.model.corners import to_corners
from topo_search.topologies.rooted import Group, Root, Symmetry, group_of

TOLERANCE = 1.0e-9
"""Largest difference of two vectors that count as equal, relative to the longer one."""
HALF_TURN, MIRROR = (-1.0, -1.0, 1.0), (1.0, -1.0, 1.0)
"""Half turn of a module about its thrust axis, and its mirror that exchanges the ports +y and -y: diagonals."""
REGION = "region"
"""Kind of a feature with unordered vectors: a convex target region."""


class _Feature(NamedTuple):
    """Requirement of the task as vectors that isometries act on."""

    kind: str
    scalars: tuple[float, ...]
    """Invariant numbers."""
    polar: Array
    """Polar vectors, mapped to O v, shape (m, 3)."""
    axial: Array
    """Axial vectors, mapped to -O v, shape (k, 3)."""

    @property
    def vectors(self) -> Array:
        """All vectors, shape (m + k, 3)."""
        return np.vstack([self.polar, self.axial])


class _Kind(NamedTuple):
    """Features of one kind with the same number of vectors, which may be images of each other."""

    vectors: Array
    """Vectors of the f features, polar ones first, shape (f, m + k, 3)."""
    signs: Array
    """Signs of P v under O = -P: -1 for polar vectors, 1 for axial ones, shape (m + k, 1)."""
    same_scalars: Flags
    """True where two features have the same scalars, shape (f, f)."""
    ordered: bool
    """False for regions, whose vectors are unordered."""

    @classmethod
    def of(cls, features: list[_Feature]) -> _Kind:
        """Return features of one kind as arrays."""
        first = features[0]
        scalars = np.array([feature.scalars for feature in features])
        signs = np.repeat([-1.0, 1.0], [len(first.polar), len(first.axial)])[:, None]
        same_scalars = np.isclose(scalars[:, None], scalars, rtol=TOLERANCE, atol=0.0).all(axis=-1)
        return cls(np.array([feature.vectors for feature in features]), signs, same_scalars, first.kind != REGION)

    def maps_onto_itself(self, P: Array) -> bool:
        """True if O = -P maps each of the features onto one of them."""
        images = self.signs * self.vectors @ P.T
        if self.ordered:
            equal = _are_same(images[:, None], self.vectors).all(axis=-1)
        else:
            pairs = (_are_same(image[:, None], self.vectors[:, None]) for image in images)  # (f, m, m) each
            matches = [np.all(pair.any(axis=1), axis=1) & np.all(pair.any(axis=2), axis=1) for pair in pairs]
            equal = np.array(matches)
        return bool(np.all(np.any(self.same_scalars & equal, axis=1)))


@lru_cache(maxsize=16)
def improper_isometry(task: ResolvedTask) -> Array | None:
    """Return an improper isometry that maps the task onto itself, shape (3, 3), or None if there is none.

    It must map load cases and corners of sets onto ones with the same weight (equal load cases count as one, with
    the sum of their weights), and segments, convex regions, cones with fixed axes, planes, axes of acceleration,
    the rod's axis and a fixed p_E onto themselves, and the weight if hover is required. Balls, paths along p_E and
    cones towards the COM allow every isometry. Among several isometries the one closest to a plain reflection is
    returned. None exists if a type of module is no mirror image of
    itself.
    """
    if not all(has_symmetry(module, MIRROR) for module in task.types):
        return None
    features = _features(to_corners(task))
    kinds, best = _kinds(features), None
    for P in _rotations(features):
        nearer = best is None or np.trace(P) < np.trace(best) - TOLERANCE
        if nearer and all(kind.maps_onto_itself(P) for kind in kinds):
            best = P
    if best is None:
        return None
    O = -best
    O.flags.writeable = False
    return O


@lru_cache(maxsize=16)
def has_symmetry(module: Module, symmetry: tuple[float, float, float]) -> bool:
    """True if rotors and a custom frame are mapped onto themselves, piece by piece; a hub always is.

    Args:
        module: the module.
        symmetry: HALF_TURN or MIRROR.
    """
    if not module.rotor_table.has_symmetry(np.diag(symmetry)):
        return False
    corners = [np.array(piece.vertices) for piece in module.body.frame or ()]
    pieces = [_Feature(REGION, (), _clean(V, float(np.abs(V).max())), np.zeros((0, 3))) for V in corners]
    return all(kind.maps_onto_itself(-np.diag(symmetry)) for kind in _kinds(pieces))


def _kinds(features: list[_Feature]) -> list[_Kind]:
    groups: dict[tuple[str, int, int], list[_Feature]] = {}
    for feature in features:
        groups.setdefault((feature.kind, len(feature.polar), len(feature.axial)), []).append(feature)
    return [_Kind.of(group) for group in groups.values()]


def _features(task: ResolvedTask) -> list[_Feature]:
    """Return the features that an isometry must map onto themselves, without duplicates."""
    features = _load_cases(task)
    p_E = task.end_effector.fixed_position
    none, l_arm = np.zeros((0, 3)), task.module.arm_length
    for exposure in task.exposure:
        needs = (exposure.solid, exposure.geometry, exposure.speed or 0.0, exposure.speed_reach or 0.0)
        for shape in exposure.shapes:
            for kind, scalars, vectors in shape.landmarks:
                scale = float(np.linalg.norm(vectors, axis=1).max()) if kind == REGION else l_arm
                features.append(_Feature(kind, (*scalars, *needs), _clean(np.array(vectors), scale), none))
    flight = task.declared.flight
    if flight.keeps_reserves or flight.tilt_deg or flight.rotor_out != "none":
        features.append(_Feature("hover", (), np.array([[0.0, 0.0, 1.0]]), none))
    for axis, a in zip(np.eye(3), flight.angular_acceleration, strict=True):
        if a:
            features += [_Feature("acceleration", (a,), none, axial[None]) for axial in (axis, -axis)]
    if task.rod_axis is not None:
        features.append(_Feature("rod", (), np.array([task.rod_axis]), none))
    if p_E is not None:
        features.append(_Feature("p_E", (), _clean(np.array([p_E]), l_arm), none))
    return features


def _load_cases(task: ResolvedTask) -> list[_Feature]:
    """Return the load cases, with equal ones merged."""
    # what the end-effector exerts loads the joints in another way than what the rotors do at the COM
    apart = task.declared.joint_limits != (None, None)
    at_com = task.end_effector.fixed_position == (0.0, 0.0, 0.0) and not apart
    features: list[_Feature] = []
    # wrenches are required for every dead rotor alike, so it does not matter that a mirror exchanges rotors
    base_cases = [(case, dead) for case, dead in zip(task.load_cases, task.dead_rotors, strict=True) if not dead]
    cases = [(case, *_wrench(case, at_com, apart)) for case, _ in base_cases]
    kinds = ["load case" if dead is None else "with a rotor dead" for _, dead in base_cases]
    force, torque = task.force_unit(task.n), task.torque_unit(task.n)
    cleaned = [(case, _clean(f, force), _clean(tau, torque)) for case, f, tau in cases]
    vectors = np.array([np.vstack([f, tau]) for _, f, tau in cleaned])
    representatives: list[int] = []
    for k, (case, f, tau) in enumerate(cleaned):
        same_kind = np.array([kinds[other] == kinds[k] for other in representatives], dtype=bool)
        equal = np.flatnonzero(same_kind & _are_same(vectors[representatives], vectors[k]).all(axis=-1))
        if equal.size == 0:
            representatives.append(k)
            features.append(_Feature(kinds[k], (case.weight,), f, tau))
        else:
            i = int(equal[0])
            features[i] = features[i]._replace(scalars=(features[i].scalars[0] + case.weight,))
    return features


def _wrench(case: LoadCase, at_com: bool, apart: bool) -> tuple[Array, Array]:
    """Return forces and torques at the end-effector and at the COM, shape (2, 3) each [N], [N m].

    Their sum alone, (1, 3): forces if p_E is the COM, torques unless both are to be kept apart.
    """
    forces = np.array([case.at_end_effector.force, case.at_com.force])
    torques = np.array([case.at_end_effector.torque, case.at_com.torque])
    if not apart:
        torques = torques.sum(axis=0, keepdims=True)
    return (forces.sum(axis=0, keepdims=True) if at_com else forces), torques


def _are_same(first: Array, second: Array) -> Flags:
    """Return where vectors (..., 3) count as equal."""
    lengths = np.maximum(np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1))
    return np.asarray(np.linalg.norm(first - second, axis=-1) <= TOLERANCE * lengths)


def _clean(vectors: Array, unit: float) -> Array:
    """Return vectors (m, 3) with rounding errors replaced by zero, given the unit of their scale."""
    return np.where(np.linalg.norm(vectors, axis=1, keepdims=True) > 1.0e-12 * unit, vectors, 0.0)


def _rotations(features: list[_Feature]) -> Iterator[Array]:
    """Yield the rotations P that may map the task onto itself: those that map two vectors onto possible images.

    The second vector is the one with the largest angle to the first one's line, which is numerically the most
    accurate; lengths do not matter.
    """
    located = [
        (feature, slot)
        for feature in features
        for slot, length in enumerate(np.linalg.norm(feature.vectors, axis=1))
        if length > 0.0
    ]
    if not located:
        yield np.diag([-1.0, -1.0, 1.0])
        return
    axes = np.array([_unit(feature.vectors[slot]) for feature, slot in located])
    x = axes[0]
    across = np.linalg.norm(np.cross(x, axes), axis=1)
    second = int(np.argmax(across))
    if across[second] <= TOLERANCE:
        y = np.eye(3)[np.argmin(np.abs(x))]
        for image in _images(features, *located[0]):
            for sign in (1.0, -1.0):
                yield _frame(image, sign * y) @ _frame(x, y).T
        return
    gram, frame = x @ axes[second], _frame(x, axes[second])
    images, second_images = (np.array(list(_images(features, *located[number]))) for number in (0, second))
    for i, j in np.argwhere(np.abs(images @ second_images.T - gram) <= 4 * TOLERANCE):
        yield _frame(images[i], second_images[j]) @ frame.T


def _images(features: list[_Feature], feature: _Feature, slot: int) -> Iterator[Array]:
    """Yield possible directions of P v for a vector v of a feature: those of similar features, negated if polar."""
    sign = -1.0 if slot < len(feature.polar) else 1.0
    length = np.linalg.norm(feature.vectors[slot])
    for other in features:
        if other.kind == feature.kind:
            vectors = other.vectors if feature.kind == REGION else other.vectors[slot : slot + 1]
            for vector in vectors:
                if abs(np.linalg.norm(vector) - length) <= 4 * TOLERANCE * length:
                    yield sign * _unit(vector)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def _frame(along: Array, beside: Array) -> Array:
    """Return the right-handed orthonormal frame of two independent vectors, as columns, shape (3, 3)."""
    x = along / np.linalg.norm(along)
    z = np.cross(x, beside)
    z /= np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def exact_group(task: ResolvedTask) -> Group:
    """Return the largest group under which trees have the same optimum, with the free root."""
    if not all(has_symmetry(module, HALF_TURN) for module in task.types):
        return "c1"
    return "c2" if improper_isometry(task) is None else "d2"


@dataclass(frozen=True)
class Resolution:
    """Symmetry applied to a task."""

    group: Group
    """Turns and mirrors of the root's frame under which trees are one candidate."""
    exact: bool
    """True if all trees of a candidate have the same optimum."""
    reason: str
    """Explanation for a reader: which trees are merged, and why."""


def resolve_symmetry(task: ResolvedTask, symmetry: Symmetry = "task") -> Resolution:
    """Apply a symmetry to a task; ValueError for an unknown symmetry."""
    connectors = task.search.connectors
    root: Root = "paper" if task.search.root_ranges else "free"
    isometry, exact = improper_isometry(task), exact_group(task)
    group = group_of(symmetry, connectors=connectors, root=root, exact=exact)
    if root == "paper":
        attitude = "the paper's root" if task.search.root == "paper" else "the root's attitude given"
        if group == "c1":
            one = "lattices" if task.search.lattice else "rooted trees"
            return Resolution(group, True, f"with {attitude} no two {one} are the same design")
        return Resolution(group, False, f"lossy: with {attitude} only the identity is exact")
    module = "a type of module" if task.module_types else "the module"
    changed = f"half a turn changes {module}"
    if exact == "c1" and symmetry != "task" and (group != "c1" or connectors == "any"):
        return Resolution(group, False, f"lossy: {changed}")
    if group == "c1":
        return Resolution(group, True, f"every tree is a candidate{f': {changed}' if symmetry == 'task' else ''}")
    if group in ("c4", "d4"):
        return Resolution(group, False, "lossy: a quarter turn reverses every rotor's spin")
    turns = "turning modules by " + ("180 deg" if connectors == "aligned" else "90 deg, with opposite spin,")
    merged = f"trees that differ only by {turns} are merged"
    lacking = "the task" if all(has_symmetry(kind, MIRROR) for kind in task.types) else module
    if group == "c2":
        if symmetry != "task":
            return Resolution(group, True, merged)
        return Resolution(group, True, f"{merged}; {lacking} has no mirror symmetry")
    if isometry is None:
        return Resolution(group, False, f"lossy: {lacking} has no mirror symmetry")
    mirror = f"the task is symmetric under {describe(isometry)}, so mirror images are merged too"
    return Resolution(group, True, f"{merged}; {mirror}")


def describe(O: Array) -> str:
    """Return an improper isometry, shape (3, 3), in words."""
    turn = float(np.trace(O)) + 1.0  # twice the cosine of the turn about the normal
    if turn <= -2.0 + TOLERANCE:
        return "point reflection"
    _, _, rows = np.linalg.svd(O + np.eye(3))
    normal = rows[-1] / rows[-1][np.argmax(np.abs(rows[-1]))]
    text = ", ".join(f"{x:.4g}" for x in np.where(np.abs(normal) > TOLERANCE, normal, 0.0))
    if turn >= 2.0 - TOLERANCE:
        return f"reflection along [{text}]"
    degrees = np.degrees(np.arccos(turn / 2))
    return f"reflection along [{text}] with a turn of {degrees:.4g} deg about it"
