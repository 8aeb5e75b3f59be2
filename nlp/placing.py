"""Geometry first: hinge angles at which no two envelopes overlap, before any wrench is thought of.

A local search on exact clearances (min-conflicts with a short memory): take a pair that overlaps, turn a hinge on
the path between its modules to the best of some random angles, even if that is worse than before, and do not turn
the same hinge again at once. It gets out of the crossings in which a gradient is stuck: an envelope that pierces
another one has to go back the way it came.

| symbol | meaning | shape | unit |
|---|---|---|---|
| alpha | hinge angles of the modules 1..n-1 | (n-1,) | rad |
| gaps[i, j] | clearance of the pair; infinite on the diagonal | (n, n) | m |
"""

from __future__ import annotations

import math

import numpy as np

from nlp.assembled.chain import Chain, Links, skew
from nlp.geometry import Swept, clearance
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array

ENOUGH = 0.1
"""Clearance that the search asks for [l_arm]: room for the angles that the wrenches will want."""
TURNS = 40
"""Most turns of hinges, a module."""
HINGES = 3
"""Hinges tried a turn."""
ANGLES = 40
"""Random angles tried a hinge: a third anywhere, the rest about the present one."""
SPREAD = 0.5
"""Standard deviation of an angle about the present one [rad]."""
STRAIGHT = 0.02
"""What a radian of hinge angle counts against an overlap [l_arm]: straight platforms lift best."""
GRUDGE = 0.1
"""What a pair's overlap counts more for every turn that it lasts, so that no two overlaps can trade for ever."""
MEMORY = (3, 10)
"""Turns for which a hinge rests."""


def place(task: ResolvedTask, topology: Topology, alpha: Array, rng: np.random.Generator) -> Array:
    """Return hinge angles, found from alpha, without overlaps; those with the least overlap if there are none."""
    layout = _Layout(task, topology)
    links = layout.at(alpha)
    gaps = layout.all_gaps(links)
    best, least = alpha, layout.overlap(gaps)
    rests_until = np.zeros(len(alpha), dtype=int)
    weights = np.ones_like(gaps)
    for turn in range(TURNS * topology.n):
        if least == 0.0:
            break
        a, b = rng.choice(np.argwhere(np.triu(gaps < layout.enough)))
        path = np.flatnonzero(layout.moves[:, a] ^ layout.moves[:, b])
        awake = path[rests_until[path] <= turn]
        hinges = rng.permutation(awake if len(awake) else path)[:HINGES]
        turns = (layout.best_turn(links, gaps, weights, alpha, hinge, rng) for hinge in hinges.tolist())
        _, hinge, angle = min(turns)
        rests_until[hinge] = turn + 1 + rng.integers(*MEMORY)
        alpha = alpha.copy()
        alpha[hinge] = angle
        links = layout.at(alpha)
        gaps = layout.all_gaps(links)
        weights[gaps < layout.enough] += GRUDGE
        if layout.overlap(gaps) < least:
            best, least = alpha, layout.overlap(gaps)
    return best


class _Layout:
    """The geometry of one task and topology, the root held still."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        self._chain = Chain(topology, task.module.connector_distance)
        self._air = task.module.envelope
        self._l_arm = task.module.arm_length
        self.enough = ENOUGH * self._l_arm
        self.moves = self._chain.moves[3:].astype(bool)
        """[h, i]: the hinge of module h + 1 moves module i."""
        self._airflow = task.search.interference == "airflow"
        distance = task.body_clearance if self._airflow else task.separation
        n = topology.n
        self._distance = np.full((n, n), -math.inf if distance is None else distance)
        if self._airflow:
            for h, i in topology.bolted:
                self._distance[h, i] = self._distance[i, h] = -math.inf

    def at(self, alpha: Array) -> Links:
        """Return the poses."""
        return self._chain.at(np.concatenate([np.zeros(3), alpha]))

    def all_gaps(self, links: Links) -> Array:
        """Return the clearance of every pair."""
        n = len(links.p)
        i, j = np.triu_indices(n, 1)
        gaps = np.full((n, n), math.inf)
        gaps[i, j] = gaps[j, i] = self._gaps(links.p[i], links.z[i], links.p[j], links.z[j], self._distance[i, j])
        return gaps

    def _gaps(self, p_i: Array, z_i: Array, p_j: Array, z_j: Array, distance: Array) -> Array:
        """Return the clearance of pairs: of envelopes and centres, or of centres alone in the ablation.

        Envelopes whose midpoints are farther apart than they reach are given what that leaves, unexamined.
        """
        between: Array = np.linalg.norm(p_i - p_j, axis=-1) - distance
        if not self._airflow:
            return between
        air = self._air
        w, half = p_i - p_j, air.length / 2
        apart = np.linalg.norm(w - half * (z_i - z_j), axis=-1) - air.length - 2 * air.end_radius
        near = apart < self.enough
        d_i, d_j = (np.broadcast_to(-air.length * z, w.shape)[near] for z in (z_i, z_j))
        one = Swept(w[near], d_i, air.start_radius, air.growth)
        apart[near] = clearance(one, Swept(np.zeros(3), d_j, air.start_radius, air.growth))
        gaps: Array = np.minimum(between, apart)
        return gaps

    def overlap(self, gaps: Array) -> float:
        """Return by how much all pairs together fall short of ENOUGH [l_arm]."""
        return float(np.maximum(0.0, self.enough - gaps[np.triu_indices(len(gaps), 1)]).sum() / self._l_arm)

    def best_turn(
        self, links: Links, gaps: Array, weights: Array, alpha: Array, hinge: int, rng: np.random.Generator
    ) -> tuple[float, int, float]:
        """Return (change for the worse, hinge, angle) of the best of some random angles of a hinge."""
        angles = rng.normal(alpha[hinge], SPREAD, ANGLES)
        angles[: ANGLES // 3] = rng.uniform(-math.pi / 2, math.pi / 2, ANGLES // 3)
        angles = np.clip(angles, -math.pi / 2, math.pi / 2)
        moved, still = np.flatnonzero(self.moves[hinge]), np.flatnonzero(~self.moves[hinge])
        omega, v = links.omega[hinge + 3], links.v[hinge + 3]
        K, turn = skew(omega), (angles - alpha[hinge])[:, None, None]
        R = np.eye(3) + np.sin(turn) * K + (1 - np.cos(turn)) * (K @ K)
        c = np.cross(omega, v)  # the point of the hinge's axis next to the origin
        p, z = (links.p[moved] - c) @ R.transpose(0, 2, 1) + c, links.z[moved] @ R.transpose(0, 2, 1)
        block = np.ix_(moved, still)
        new = self._gaps(p[:, :, None], z[:, :, None], links.p[still], links.z[still], self._distance[block])
        overlaps = np.maximum(0.0, self.enough - new) / self._l_arm
        worse = np.einsum("amb,mb->a", overlaps, weights[block]) + STRAIGHT * np.abs(angles)
        overlaps = np.maximum(0.0, self.enough - gaps[block]) / self._l_arm
        before = np.sum(overlaps * weights[block]) + STRAIGHT * abs(alpha[hinge])
        least = int(np.argmin(worse))
        return float(worse[least] - before), hinge, float(angles[least])
