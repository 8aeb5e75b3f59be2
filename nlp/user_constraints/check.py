r"""Users' constraints checked: on a final design, and before a search on platforms listed in several ways.

A constraint may claim not to tell these listings apart. A platform is drawn at random, then listed from another
module, with modules turned by half, or mirrored. What is found equal here need not be equal everywhere: this
refuses claims, and proves none.

| symbol | meaning | shape |
|---|---|---|
| R_i, o_i, p_E, u_i | poses, end-effector and inputs of one listing | (3,3), (3,), (3,), (4,) |
| t_i | quarter turns from a module's own axes to those that it has in another listing | |
| O, M | the mirror in the world; in a module: the ports +y and -y change places | (3, 3) |

.. math:: R'_i = R_i R_z(t_i \pi/2), \qquad R'_i = O R_i M
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from nlp.numbers.geometry import poses, root_rotation, rotation
from nlp.user_constraints.rows import TOLERANCE, UserRows, platform_of, rows, scale_of
from topo_search.model import BadInput, Design, Fault, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.design import StatedCheck
from topo_search.protocols import OwnConstraint, SymbolicPlatform

DRAWS = 256
"""Random platforms; each value of an own constraint must be finite on one of them."""


def check_stated(
    constraints: Sequence[OwnConstraint],
    design: Design,
    *,
    orientations: Array,
    centres: Array,
    end_effector: Array,
) -> tuple[StatedCheck, ...]:
    """Return what own constraints come to on a design, by their own expressions at poses that others computed.

    Args:
        constraints: what is checked.
        design: its angles and inputs.
        orientations: R_i, shape (n, 3, 3).
        centres: o_i from the centre of mass, shape (n, 3) [m].
        end_effector: p_E from the centre of mass, shape (3,) [m].
    """
    platform = platform_of(
        design.task,
        design.topology,
        orientations=orientations,
        centres=centres,
        end_effector=end_effector,
        hinge_angles=design.hinge_angles_rad,
        inputs=design.rotor_speeds_squared,
    )
    return tuple(_check(one, platform) for one in constraints)


def _check(constraint: OwnConstraint, platform: SymbolicPlatform) -> StatedCheck:
    values = np.asarray(ca.evalf(rows(constraint, platform)), dtype=float).ravel()
    if not np.all(np.isfinite(values)):  # a constraint that has no value is not met
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
    """Try own constraints on the symbols of one topology, and on random values of them, before workers do.

    Raises:
        BadInput: names the constraint, and what its expression raises or returns in place of expressions.
    """
    rng = np.random.default_rng(0)
    for constraint in constraints:
        try:
            user_rows = UserRows([constraint], task, topology)
            known = {symbol.element_hash() for symbol in ca.symvar(user_rows.x)}
            foreign = [symbol.name() for symbol in ca.symvar(user_rows.g) if symbol.element_hash() not in known]
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
            rule = f"cannot be stated for {topology.key}: {' '.join(reason.split())}"
            raise BadInput("constraints", [Fault(constraint.name, rule)]) from error


class InvarianceTest(NamedTuple):
    """The test of claims of invariance."""

    draws: int = 8
    """Platforms that each claim is tried on."""
    agreement: float = 1e-7
    """Largest relative difference by rounding between the violations of a constraint in two listings."""


INVARIANCE = InvarianceTest()


MIRROR = np.diag([1.0, -1.0, 1.0])
"""M."""


def refuse_wrong_claims(
    constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology, *, mirror: Array | None
) -> None:
    """Try what own constraints say of their invariance.

    Args:
        constraints: what is tried.
        task: the task.
        topology: a tree of it.
        mirror: an improper isometry that maps the task onto itself, shape (3, 3); None: it has none.

    Raises:
        BadInput: names the constraint, the claim, and what it comes to in two listings of one platform.
    """
    rng = np.random.default_rng(0)
    claims = [one for one in constraints if one.invariant != "none"]
    for _ in range(INVARIANCE.draws if claims else 0):
        listing = _Listing.draw(task, topology, rng)
        other = listing.relist(int(rng.integers(topology.n)), int(2 * rng.integers(2)))
        for one in claims:
            _compare(one, listing, other, "numbering")
            if one.invariant == "mirror" and mirror is not None:
                _compare(one, listing, listing.mirror(mirror), "mirror")


def _compare(constraint: OwnConstraint, listing: _Listing, other: _Listing, claim: str) -> None:
    missed, there = (_violation(constraint, each.platform()) for each in (listing, other))
    if not abs(missed - there) <= INVARIANCE.agreement * max(1.0, abs(missed), abs(there)):
        rule = (
            f"says that it is invariant to {claim}, but one platform is {missed:.6g} {constraint.unit} beyond its "
            f"bounds as {listing.topology.key} and {there:.6g} as {other.topology.key}"
        )
        raise BadInput("constraints", [Fault(constraint.name, rule)])


def _violation(constraint: OwnConstraint, platform: SymbolicPlatform) -> float:
    """Return by how much the values of an expression are beyond their bounds at most."""
    values = np.asarray(ca.evalf(rows(constraint, platform)), dtype=float).ravel()
    return float(np.max(np.maximum(constraint.lower - values, values - constraint.upper)))


class _Listing:
    """A platform in numbers, listed from one of its modules."""

    def __init__(self, task: ResolvedTask, topology: Topology, R: Array, o: Array, p_E: Array, u: Array) -> None:
        self.task, self.topology = task, topology
        self.R, self.o, self.p_E, self.u = R, o, p_E, u

    @classmethod
    def draw(cls, task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> _Listing:
        """Return a random platform; all load cases have the same inputs, since a mirror may exchange them."""
        n, l_c = topology.n, task.module.connector_distance
        R, p = poses(topology, root_rotation(rng.uniform(-1.5, 1.5, 3)), rng.uniform(-1.0, 1.0, n - 1), l_c)
        u = rng.uniform(0.0, task.module.max_input(task.gravity), (n, 4))
        return cls(task, topology, R, p - p.mean(axis=0), rng.normal(size=3), u)

    def relist(self, root: int, turns: int) -> _Listing:
        """Return the platform listed from another module, with that module's axes turned by quarter turns."""
        import networkx as nx

        graph, order, joints = self.topology.graph(), [root], [(-1, -1, -1)]
        for h, i in nx.bfs_edges(graph, root):
            ports = graph.edges[h, i]["ports"]
            a = (ports[h] - turns) % 4 if h == root else ports[h]
            joints.append((order.index(h), a, ports[i]))
            order.append(i)
        rough = Topology(tuple(joints))
        topology = Topology.from_key(rough.key)
        # the key lists modules in preorder, every one entered through the port opposite to its parent's
        places, t = {0: 0}, {0: turns}
        children = {(h, a): (i, b) for h, i, a, b in rough.edges()}
        shift = {0: 0}
        for h, i, a, b in topology.edges():
            old, b_old = children[places[h], (a + shift[h]) % 4]
            places[i], shift[i] = old, (b_old - b) % 4
            t[i] = shift[i]
        modules = [order[places[i]] for i in range(topology.n)]
        R = np.array([self.R[m] @ rotation([0, 0, 1], t[i] * np.pi / 2) for i, m in enumerate(modules)])
        u = np.array([np.roll(self.u[m], t[i]) for i, m in enumerate(modules)])
        return _Listing(self.task, topology, R, self.o[modules], self.p_E, u)

    def mirror(self, O: Array) -> _Listing:
        """Return the mirror image: the ports +y and -y of every module change places, and so do its rotors."""
        swap = (0, 3, 2, 1)
        joints = [(h, swap[a] if h >= 0 else a, swap[b] if h >= 0 else b) for h, a, b in self.topology.joints]
        rough = Topology(tuple(joints))
        R = np.einsum("ab,ibc,cd->iad", O, self.R, MIRROR)
        image = _Listing(self.task, rough, R, self.o @ O.T, O @ self.p_E, self.u[:, [3, 2, 1, 0]])
        return image.relist(0, 0)

    def platform(self) -> SymbolicPlatform:
        """Return what a constraint is called with."""
        alpha = []
        for (h, i, a, _), kappa in zip(self.topology.edges(), self.topology.kappas[1:], strict=True):
            H = self.R[h].T @ self.R[i] @ rotation([0, 0, 1], -kappa * np.pi / 2)
            alpha.append(float(np.arctan2(H[0, 2] if a % 2 == 0 else H[2, 1], H[2, 2])))
        return platform_of(
            self.task,
            self.topology,
            orientations=self.R,
            centres=self.o,
            end_effector=self.p_E,
            hinge_angles=alpha,
            inputs=[self.u.ravel()] * len(self.task.load_cases),
        )
