"""Trees that an exact quotient takes for one build the same platform at any hinge angles; others do not.

The platform of one tree is taken as it stands in space (module poses, rotors with their spins, hinges), and
another tree is laid over it: wherever its root may be, does some choice of its hinge angles put the same rotors,
turning the same way, in the same places?
"""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from suites import few
from test_topologies_task_symmetry import random_rotation

from topo_search.model import Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import Connectors, candidate_of, candidates

Array = NDArray[np.float64]
PORTS = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
ROTORS = np.array([[1.0, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]]) / 2
SPINS = np.array([-1.0, 1, -1, 1])
TOUCH = 1e-9


class Platform(NamedTuple):
    R: Array
    p: Array
    hinges: list[tuple[Array, int, int]]
    """Place of each hinge and the modules that it joins."""
    rotors: Array
    """Place, thrust axis and spin of every rotor, shape (4n, 7)."""
    angles: Array


def turn(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R[j, j], R[j, k], R[k, j], R[k, k] = c, -s, s, c
    return R


def build(topology: Topology, angles: Array, root: Array) -> Platform:
    """Poses by the kinematics of the model, l_c = 1."""
    R, p, hinges = [root], [np.zeros(3)], []
    for (h, i, a, _), kappa in zip(topology.edges(), topology.kappas[1:], strict=True):
        behind = R[h] @ turn(1 - a % 2, angles[i - 1])
        hinges.append((p[h] + R[h] @ PORTS[a], h, i))
        p.append(p[h] + (R[h] + behind) @ PORTS[a])
        R.append(behind @ turn(2, kappa * np.pi / 2))
    return with_rotors(np.array(R), np.array(p), hinges, angles)


def with_rotors(R: Array, p: Array, hinges: list[tuple[Array, int, int]], angles: Array) -> Platform:
    places = p[:, None] + np.einsum("nij,qj->nqi", R, ROTORS)
    axes = np.repeat(R[:, None, :, 2], 4, axis=1)
    spins = np.broadcast_to(SPINS[None, :, None], (len(R), 4, 1))
    return Platform(R, p, hinges, np.concatenate([places, axes, spins], axis=2).reshape(-1, 7), angles)


def mirrored(platform: Platform, O: Array) -> Platform:
    """The image under an improper isometry, which reverses every spin; frames of modules stay right-handed."""
    hinges = [(O @ c, h, i) for c, h, i in platform.hinges]
    rotors = np.hstack([platform.rotors[:, :3] @ O.T, platform.rotors[:, 3:6] @ O.T, -platform.rotors[:, 6:]])
    R = O @ platform.R @ np.diag([1.0, -1, 1])
    return Platform(R, platform.p @ O.T, hinges, rotors, platform.angles)


def builds(topology: Topology, platform: Platform) -> bool:
    """Whether the tree can be laid over the platform, from any module and in any of the four ways."""
    for module in range(topology.n):
        for quarters in range(4):
            angles = angles_over(topology, platform, module, platform.R[module] @ turn(2, quarters * np.pi / 2))
            if angles is None:
                continue
            copy = build(topology, angles, platform.R[module] @ turn(2, quarters * np.pi / 2))
            rotors = copy.rotors.copy()
            rotors[:, :3] += platform.p[module]
            if same_rows(rotors, platform.rotors):
                assert np.allclose(np.sort(np.abs(angles)), np.sort(np.abs(platform.angles)), atol=1e-9)
                return True
    return False


def angles_over(topology: Topology, platform: Platform, module: int, root: Array) -> Array | None:
    """The hinge angles at which the tree follows the platform's hinges and thrust axes, if it can."""
    over, R, angles = [module], [root], []
    for (h, _, a, _), kappa in zip(topology.edges(), topology.kappas[1:], strict=True):
        here = platform.p[over[h]] + R[h] @ PORTS[a]
        ends = [(j, k) for c, j, k in platform.hinges if over[h] in (j, k) and np.linalg.norm(c - here) < TOUCH]
        if not ends:
            return None
        (ends_at,) = ends
        over.append(ends_at[0] if ends_at[1] == over[h] else ends_at[1])
        z = R[h].T @ platform.R[over[-1]][:, 2]
        angle = np.arctan2(z[0], z[2]) if a % 2 == 0 else np.arctan2(-z[1], z[2])
        angles.append(angle)
        R.append(R[h] @ turn(1 - a % 2, angle) @ turn(2, kappa * np.pi / 2))
    return np.array(angles)


def same_rows(A: Array, B: Array) -> bool:
    near = np.linalg.norm(A[:, None] - B[None], axis=2) < 1e-7
    return bool(np.all(near.sum(axis=0) == 1) and np.all(near.sum(axis=1) == 1))


def random_platform(topology: Topology, rng: np.random.Generator) -> Platform:
    return build(topology, rng.uniform(-1.4, 1.4, topology.n - 1), random_rotation(rng))


@pytest.mark.parametrize("n", few([1, 2, 3, 4], 3))
def test_half_turn_classes_are_the_different_aligned_platforms(n: int) -> None:
    rng = np.random.default_rng(n)
    listed = list(candidates(n))
    for rooted in candidates(n, symmetry="none", root="paper"):
        platform = random_platform(rooted.topology, rng)
        building = [candidate.key for candidate in listed if builds(candidate.topology, platform)]
        assert building == [candidate_of(rooted.topology).key]


@pytest.mark.parametrize("n", few([1, 2, 3, 4], 3))
def test_quarter_turns_with_spin_flip_are_the_different_platforms_of_any_port(n: int) -> None:
    rng = np.random.default_rng(n)
    listed = list(candidates(n, connectors="any"))
    rooted = list(candidates(n, symmetry="none", root="paper", connectors="any"))
    for candidate in rooted if n < 4 else rng.choice(np.array(rooted), 25, replace=False):
        platform = random_platform(candidate.topology, rng)
        building = [other.key for other in listed if builds(other.topology, platform)]
        assert building == [candidate_of(candidate.topology, connectors="any").key]


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_without_symmetry_the_root_alone_is_left_out(n: int) -> None:
    rng = np.random.default_rng(n)
    for connectors in ("aligned", "any"):
        for rooted in list(candidates(n, symmetry="none", root="paper", connectors=connectors))[::7]:
            candidate = candidate_of(rooted.topology, symmetry="none", connectors=connectors)
            assert builds(candidate.topology, random_platform(rooted.topology, rng))


@pytest.mark.parametrize("connectors", ["aligned", "any"])
@pytest.mark.parametrize("n", few([1, 2, 3, 4], 3))
def test_mirror_classes_are_the_platforms_up_to_an_improper_isometry(n: int, connectors: Connectors) -> None:
    rng = np.random.default_rng(n)
    task = read_task("push").resolve(n)
    listed = list(candidates(n, symmetry="task", task=task, connectors=connectors))
    rooted = list(candidates(n, symmetry="none", root="paper", connectors=connectors))
    for candidate in rooted if len(rooted) < 80 else rng.choice(np.array(rooted), 12, replace=False):
        platform = random_platform(candidate.topology, rng)
        image = mirrored(platform, -random_rotation(rng))
        building = [
            other.key for other in listed if builds(other.topology, platform) or builds(other.topology, image)
        ]
        expected = candidate_of(candidate.topology, symmetry="task", task=task, connectors=connectors)
        assert building == [expected.key]
        exact = candidates(n, connectors=connectors)
        merged = [one for one in exact if builds(one.topology, platform) or builds(one.topology, image)]
        assert len(merged) == expected.orbit


def test_a_quarter_turn_of_an_aligned_tree_reverses_every_spin() -> None:
    rng = np.random.default_rng(0)
    for candidate in candidates(4, symmetry="c4"):
        platform = random_platform(candidate.topology, rng)
        reversed_spins = platform._replace(rotors=platform.rotors * np.array([1, 1, 1, 1, 1, 1, -1]))
        building = [
            other.key
            for other in candidates(4)
            if builds(other.topology, platform) or builds(other.topology, reversed_spins)
        ]
        assert len(building) == candidate.orbit
        classes = {candidate_of(Topology.from_key(key), symmetry="c4").key for key in building}
        assert classes == {candidate.key}
