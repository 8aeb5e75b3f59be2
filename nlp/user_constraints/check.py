r"""Checks of user constraints: on a final design, and before a search, of their invariance on random platforms.

A constraint may claim that it does not change with the numbering of modules or with mirroring. A random platform is
numbered from another module, with modules turned by half a turn, or mirrored. Equal values do not prove a claim;
different ones refute it.

| symbol | meaning | shape |
|---|---|---|
| R_i, o_i, p_E, u_i | poses, end-effector and inputs in one numbering | (3,3), (3,), (3,), (r,) |
| t_i | quarter turns from a module's axes to its axes in another numbering | |
| O, M | mirror of the world; mirror of a module, which swaps the ports +y and -y | (3, 3) |

.. math:: R'_i = R_i R_z(t_i \pi/2), \qquad R'_i = O R_i M
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from nlp.numbers.geometry import poses, root_rotation, rotation
from nlp.user_constraints.rows import TOLERANCE, UserRows, platform_of, rows, scale_of
from topo_search.model import Array, BadInput, Design, Fault, ResolvedTask, Topology
from topo_search.model.stated import StatedCheck
from topo_search.own_constraint import OwnConstraint, SymbolicPlatform

DRAWS = 256
"""Number of random platforms; each value of a user constraint must be finite on one of them."""


def check_user_constraints(
    constraints: Sequence[OwnConstraint],
    design: Design,
    *,
    orientations: Array,
    centres: Array,
    end_effector: Array,
) -> tuple[StatedCheck, ...]:
    """Evaluate user constraints on a design, at independently computed poses.

    Args:
        constraints: the constraints to check.
        design: the design, for its angles and inputs.
        orientations: R_i, shape (n, 3, 3).
        centres: o_i from the centre of mass, shape (n, 3) [m].
        end_effector: p_E from the centre of mass, shape (3,) [m].
    """
    tree, pose = (design.task, design.topology, design.mount), (end_effector, centres, orientations)
    platform = platform_of(tree, pose, design.hinge_angles_rad, design.rotor_speeds_squared)
    return tuple(_check(constraint, platform) for constraint in constraints)


def _check(constraint: OwnConstraint, platform: SymbolicPlatform) -> StatedCheck:
    values = np.asarray(ca.evalf(rows(constraint, platform)), dtype=float).ravel()
    if not np.all(np.isfinite(values)):  # without a value it is not met
        return StatedCheck(**constraint.stated.model_dump(), status="missed")
    beyond = np.maximum(constraint.lower - values, values - constraint.upper)
    worst = int(np.argmax(beyond))
    met = beyond[worst] <= TOLERANCE * scale_of(constraint, platform.task)
    return StatedCheck(
        **constraint.stated.model_dump(),
        status="met" if met else "missed",
        value=float(values[worst]),
        off_by=float(beyond[worst]),
    )


def refuse_unusable(constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology) -> None:
    """Evaluate user constraints symbolically for one topology, and on random values, before any worker does.

    Raises:
        BadInput: names the constraint, and the exception or the wrong return value of its expression.
    """
    rng = np.random.default_rng(0)
    for constraint in constraints:
        try:
            user_rows = UserRows([constraint], task, topology)
            unknowns = {symbol.element_hash() for symbol in ca.symvar(user_rows.x)}
            foreign = [symbol.name() for symbol in ca.symvar(user_rows.g) if symbol.element_hash() not in unknowns]
            if foreign:
                raise ValueError(f"may use only the platform's symbols, but has {', '.join(foreign)}")
            _ = user_rows.bounds
            finite = np.zeros(user_rows.g.shape, dtype=bool)
            for _ in range(DRAWS):
                finite |= np.isfinite(np.asarray(user_rows.values(user_rows.draw(rng))))
                if np.all(finite):
                    break
            else:
                raise ValueError(f"must have a finite value, but has none on {DRAWS} random platforms")
        except Exception as error:
            reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            rule = f"cannot be evaluated for {topology.key}: {' '.join(reason.split())}"
            raise BadInput("constraints", [Fault(constraint.name, rule)]) from error


class InvarianceTest(NamedTuple):
    """Settings of the test of claimed invariance."""

    draws: int = 8
    """Number of platforms on which each claim is tested."""
    agreement: float = 1e-7
    """Largest relative difference, due to rounding, of a constraint's violations in two numberings."""


INVARIANCE = InvarianceTest()


MIRROR = np.diag([1.0, -1.0, 1.0])
"""M."""


def refuse_wrong_claims(
    constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology, *, mirror: Array | None
) -> None:
    """Test the claimed invariance of user constraints on random platforms.

    Args:
        constraints: the constraints to test.
        task: the task.
        topology: a tree of modules.
        mirror: an improper isometry that maps the task onto itself, shape (3, 3); None: it has none.

    Raises:
        BadInput: names the constraint, the claim, and its violations in two numberings of one platform.
    """
    rng = np.random.default_rng(0)
    claims = [constraint for constraint in constraints if constraint.invariant != "none"]
    for _ in range(INVARIANCE.draws if claims else 0):
        listing = _Numbering.draw(task, topology, rng)
        renumbered = listing.renumber(int(rng.integers(topology.n)), int(2 * rng.integers(2)))
        for constraint in claims:
            _compare(constraint, listing, renumbered, "numbering")
            if constraint.invariant == "mirror" and mirror is not None:
                _compare(constraint, listing, listing.mirror(mirror), "mirror")


def _compare(constraint: OwnConstraint, listing: _Numbering, changed: _Numbering, claim: str) -> None:
    first, second = (_violation(constraint, numbering.platform()) for numbering in (listing, changed))
    if not abs(first - second) <= INVARIANCE.agreement * max(1.0, abs(first), abs(second)):
        rule = (
            f"says that it is invariant to {claim}, but one platform is {first:.6g} {constraint.unit} beyond its "
            f"bounds as {listing.topology.key} and {second:.6g} as {changed.topology.key}"
        )
        raise BadInput("constraints", [Fault(constraint.name, rule)])


def _violation(constraint: OwnConstraint, platform: SymbolicPlatform) -> float:
    """Return the largest violation of a constraint's bounds."""
    values = np.asarray(ca.evalf(rows(constraint, platform)), dtype=float).ravel()
    return float(np.max(np.maximum(constraint.lower - values, values - constraint.upper)))


class _Numbering:
    """A numeric platform with one of its numberings of modules."""

    def __init__(self, task: ResolvedTask, topology: Topology, R: Array, o: Array, p_E: Array, u: Array) -> None:
        self.task, self.topology = task, topology
        self.R, self.o, self.p_E, self.u = R, o, p_E, u

    @classmethod
    def draw(cls, task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> _Numbering:
        """Return a random platform; all load cases have the same inputs, since a mirror may swap cases."""
        n, l_c = topology.n, task.connector_distances
        R, p = poses(topology, root_rotation(rng.uniform(-1.5, 1.5, 3)), rng.uniform(-1.0, 1.0, n - 1), l_c)
        u = rng.uniform(0.0, task.module.max_input(task.gravity), (n, task.rotors_per_module))
        u *= task.input_shares > 0
        return cls(
            task, Topology(topology.joints, types=topology.types), R, p - p.mean(axis=0), rng.normal(size=3), u
        )

    def renumber(self, root: int, turns: int) -> _Numbering:
        """Return the platform numbered from module `root`, with the axes of that module turned by quarter turns."""
        import networkx as nx

        graph, order, joints = self.topology.graph(), [root], [(-1, -1, -1)]
        for h, i in nx.bfs_edges(graph, root):
            ports = graph.edges[h, i]["ports"]
            a = (ports[h] - turns) % 4 if h == root else ports[h]
            joints.append((order.index(h), a, ports[i]))
            order.append(i)
        types = tuple(self.topology.types[i] for i in order if self.topology.types)
        unsorted = Topology(tuple(joints), types=types)
        topology = Topology.from_key(unsorted.key)
        # the key has modules in preorder, each attached by the port opposite to its parent's
        source_index, t = {0: 0}, {0: turns}
        children = {(h, a): (i, b) for h, i, a, b in unsorted.edges()}
        shift = {0: 0}
        for h, i, a, b in topology.edges():
            source, b_source = children[source_index[h], (a + shift[h]) % 4]
            source_index[i], shift[i] = source, (b_source - b) % 4
            t[i] = shift[i]
        modules = [order[source_index[i]] for i in range(topology.n)]
        turned = [rotation([0, 0, 1], t[i] * np.pi / 2) for i in range(len(modules))]
        R = np.array([self.R[m] @ turn for m, turn in zip(modules, turned, strict=True)])
        u = np.array([self._moved_inputs(m, turn) for m, turn in zip(modules, turned, strict=True)])
        return _Numbering(self.task.on(topology), topology, R, self.o[modules], self.p_E, u)

    def _moved_inputs(self, m: int, Q: Array) -> Array:
        """Return the inputs of a module turned or mirrored by Q, shape (r,)."""
        rotors, u = self.task.modules_of_nodes[m].rotor_table, self.u[m].copy()
        if rotors.count:
            u[: rotors.count] = u[rotors.images(Q)]
        return np.asarray(u)

    def mirror(self, O: Array) -> _Numbering:
        """Return the mirror image: the ports +y and -y of every module are swapped, and its rotors accordingly."""
        swap = (0, 3, 2, 1)
        joints = [(h, swap[a] if h >= 0 else a, swap[b] if h >= 0 else b) for h, a, b in self.topology.joints]
        unsorted = Topology(tuple(joints), types=self.topology.types)
        R = np.einsum("ab,ibc,cd->iad", O, self.R, MIRROR)
        u = np.array([self._moved_inputs(m, MIRROR) for m in range(len(R))])
        image = _Numbering(self.task, unsorted, R, self.o @ O.T, O @ self.p_E, u)
        return image.renumber(0, 0)

    def platform(self) -> SymbolicPlatform:
        """Return the argument of a constraint's expression."""
        alpha = []
        for (h, i, a, _), kappa in zip(self.topology.edges(), self.topology.kappas[1:], strict=True):
            H = self.R[h].T @ self.R[i] @ rotation([0, 0, 1], -kappa * np.pi / 2)
            alpha.append(float(np.arctan2(H[0, 2] if a % 2 == 0 else H[2, 1], H[2, 2])))
        tree, inputs = (self.task, self.topology, None), [self.u.ravel()] * len(self.task.load_cases)
        return platform_of(tree, (self.p_E, self.o, self.R), alpha, inputs)
