r"""Jet model of the air that modules move: speeds at points, and upper bounds over balls.

Lengths are in the l_arm of `[module]`. A module with rotors q = 1..r, in its own frame, with its jet along -z:

| symbol | meaning | unit |
|---|---|---|
| T_q | thrust of a rotor, k_f u_q | N |
| rho, R, L | density of air; radius of rotor q; distance between opposite rotors | kg/m^3, m, m |
| v_q, a_q | induced speed of a disc, sqrt(T_q / (2 rho pi R^2)); its share in the area of all | m/s, |
| s, r | depth below the centre and distance from the axis, in L | |
| z, d_q, r_q | depth below disc q, along its axis; distance from the disc; distance from its axis | m |
| D, s_0, b | constants of the far field: decay, origin, half_width of `module.airflow.jet` | |
| c | share of the far field | |
| g | speed on a slipstream's axis over v_q | |
| delta, r_2 | half-width of a slipstream's shear layer, its outer radius | m |

The square of the speed is linear in the thrusts:

.. math::

    U^2 &= \sum_q v_q^2 \max\big(G_q, H_q\big), \qquad
    G_q = (1 - c) S_q^2 + c\, a_q M^2, \quad c = \mathrm{clip}\big(\tfrac{s - 1}{1.5}, 0, 1\big) \\
    \text{far field}\ M &= \frac{D}{s' + s_0} \Big(1 + (\sqrt 2 - 1) \frac{r^2}{b^2 (s' + s_0)^2}\Big)^{-2}, \quad
        s' = \max(s, 2.5) \\
    \text{slipstream}\ S_q &= g\, \mathrm{clip}\Big(\frac{r_2 - r_q}{2 \delta}, 0, 1\Big) \text{ for } z \ge 0,
        \quad g = 1 + \frac{z}{\sqrt{R^2 + z^2}}, \quad \delta = 0.1 (z + R) \\
    \text{inflow}\ H_q &= k_q \sum_p k_p, \quad k_q = (1 + \sqrt 2 d_q / R)^{-2}

A slipstream is that of an actuator disc. Its outer radius lets it carry g / 2 of its rotor's thrust as momentum;
the rest is pressure. With a = R^2 / g, the area over pi in which it would do so at the speed v_q g:

.. math::

    r_2 = \tfrac43 \delta + \sqrt{a - \tfrac29 \delta^2} \text{ if } a \ge \tfrac23 \delta^2, \qquad
    r_2 = (24 \delta^2 a)^{1/4} \text{ otherwise.}

From s = 1 to 2.5 the slipstreams give way to the far field, of Bauersfeld et al., "Robotics meets Fluid Dynamics"
(RA-L 2024, arXiv 2403.13321), measured for single quadrotors. Squares of speeds are joined linearly, and so is the
momentum that they carry: it goes from the thrust to the share of it that the far field carries
(`Module.jet_momentum`).

The inflow is v_q at the disc and a sink of half its flow, v_q R^2 / (2 d^2), far from it. It counts for a rotor
wherever it exceeds the rotor's share of the jet: above the discs and beside the jet. By Cauchy's inequality the sum
of squares is at least (sum_q v_q k_q)^2, the square of the sinks' sum, and equal to it for equal rotors.

A slipstream is along its rotor's axis, the far field along the module's. Where rotors tilt so far that each has its
own envelope (`RotorTable.has_own_jets`), their jets do not merge: each has a far field of its own along its axis,
with a_q = 1 and L = 2 R. The far field was measured for quadrotors; L is the distance of opposite rotors, or twice
the farthest rotor's distance from the axis, and no less than 2 R. So a single rotor keeps 0.968 of its momentum.
Modules of several types have the jets of their types; of rotors that a type lacks, v_q, a_q and k_q are 0.

Jets are straight; speeds are time averages in free air, without walls, ground or wind. Peaks of a jet are about 1.5
times as high. Swirl is left out: if it is as fast in all of a slipstream, a rotor's torque makes it
1.5 sqrt 2 k_tau / (k_f R) of the axial speed, which adds 6 % to the speed for the default module.

Bounds over a ball of radius h about x: it spans depths z_1 = z - h to z_2 = z + h and distances from r - h on. g,
delta and c grow with depth, a and D / (s' + s_0) fall; r_2 grows with delta and with a, in either case. S_q and k_q
fall with r_q and d_q, M with r and more slowly the deeper. So each factor is bounded where it is largest: c, g and
b (s' + s_0) at z_2, 1 - c and D / (s' + s_0) at z_1, r_2 by delta at z_2 and a at z_1, over delta at z_1. A ball
may also be turned about the module's axis by an arc: r and s stay, r_q and d_q change by at most the arc, and z by
the arc times the sine of the largest tilt. At h = 0 the bound is the speed itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Module
from verify.kinematics import per_rotor


class JetModel(NamedTuple):
    """Constants of the jet model."""

    merged_at: float = 2.5
    """Depth from which the far field is the whole jet [L]."""
    merges_over: float = 1.5
    """Range of depth before that over which slipstreams give way to it [L]."""
    shear: float = 0.1
    """Growth of the shear layer's half-width per depth."""


MODEL = JetModel()


class Jets(NamedTuple):
    """The jets of n modules."""

    centres: Array
    """Shape (n, 3) [l_arm]."""
    poses: Array
    """Orientations R_i, shape (n, 3, 3)."""
    rotors: Array
    """Centres of the discs, shape (n, r, 3) [l_arm]."""
    induced: Array
    """v_q, shape (n, r) [m/s]."""
    radii: Array
    """R of each, shape (r,), or (n, r) of modules of several types, as are all below [l_arm]."""
    axes: Array
    """Directions of the rotors' thrusts in the module's frame, shape (r, 3)."""
    alone: Array
    """True where the jets of rotors do not merge, shape (1,)."""
    diameters: Array
    """L of each merged jet, of modules, shape (1,), or rotors, shape (r,) [l_arm]."""
    shares: Array
    """a_q, shape (r,)."""
    decay: Array | float
    origin: Array | float
    half_width: Array | float
    reach: float
    """Largest distance of a disc's centre from its module's [l_arm]."""

    @property
    def rotor_axes(self) -> Array:
        """Directions of the rotors' thrusts, shape (n, r, 3)."""
        axes = np.broadcast_to(self.axes, self.rotors.shape)
        return np.asarray(np.einsum("nij,nqj->nqi", self.poses, axes))

    @property
    def merged(self) -> tuple[Array, Array]:
        """Where merged jets start, and their axes against the flow: of modules, (n, 1, 3), or rotors, (n, r, 3)."""
        centres, axes = self.centres[:, None], self.poses[:, None, :, 2]
        if not self.alone.any():
            return centres, axes
        alone = self.alone[..., None]
        return np.where(alone, self.rotors, centres), np.where(alone, self.rotor_axes, axes)

    @property
    def ended(self) -> float:
        """Distance from a module beyond which the slipstreams of single rotors have ended [l_arm]."""
        return 2 * (MODEL.merged_at * float(self.diameters.max()) + self.reach + 2 * float(self.radii.max()))

    def drop(self, module: int) -> Jets:
        """Return the jets of all other modules."""
        shared = self._fields[4:] if self.radii.ndim == 1 else ("reach",)
        names = (name for name in self._fields if name not in shared)
        return self._replace(**{name: np.delete(getattr(self, name), module, axis=0) for name in names})


def jets(
    modules: Module | Sequence[Module],
    density: float,
    centres: Array,
    poses: Array,
    rotors: Array,
    squared_speeds: Array,
    l_arm: float | None = None,
) -> Jets:
    """Return the jets of modules.

    Args:
        modules: the properties of each module, or of all.
        density: rho [kg/m^3].
        centres: positions of the modules, shape (n, 3) [l_arm].
        poses: orientations, shape (n, 3, 3).
        rotors: centres of the discs, shape (n, r, 3) [l_arm].
        squared_speeds: u, shape (n, r) [rad^2/s^2]; negative values count as zero.
        l_arm: unit of lengths [m]; None: that of the modules.
    """
    modules = (modules,) if isinstance(modules, Module) else modules
    l_arm, several = l_arm or modules[0].arm_length, len(set(modules)) > 1
    modules = modules if several else modules[:1]
    k_f = per_rotor(modules, lambda module: module.thrust_coefficient * module.rotor_table.gains)
    discs = per_rotor(modules, lambda module: 2 * density * math.pi * module.rotor_radii**2)
    induced = np.sqrt(k_f * np.maximum(squared_speeds, 0.0) / np.where(discs, discs, 1.0))
    radii = per_rotor(modules, lambda module: module.rotor_radii / l_arm)
    alone = np.array([[module.rotor_table.has_own_jets] for module in modules])
    merged = None if alone.any() else 1
    diameters = per_rotor(modules, lambda module: _diameters(module, l_arm)[:merged])
    fields = {
        "radii": np.where(radii, radii, 1.0),
        "axes": per_rotor(modules, lambda module: module.rotor_table.axes),
        "alone": alone,
        "diameters": np.where(diameters, diameters, 1.0),
        "shares": per_rotor(modules, _shares),
        "decay": np.array([[module.airflow.jet.decay] for module in modules]),
        "origin": np.array([[module.airflow.jet.origin] for module in modules]),
        "half_width": np.array([[module.airflow.jet.half_width] for module in modules]),
    }
    reach = max(
        module.arm_length / l_arm * float(module.rotor_table.distances.max(initial=0.0)) for module in modules
    )
    columns = {name: column if several else column[0] for name, column in fields.items()}
    return Jets(centres, poses, rotors, induced, **columns, reach=reach)


def _diameters(module: Module, l_arm: float) -> Array:
    """Return L of the merged jet of each rotor, shape (r,) [l_arm]."""
    own = module.arm_length
    return np.asarray(2 * (own / l_arm) * module.rotor_table.jet_radii(module.rotor_radii / own))


def _shares(module: Module) -> Array:
    """Return a_q, shape (r,)."""
    areas = module.rotor_radii**2
    return np.ones_like(areas) if module.rotor_table.has_own_jets else np.asarray(areas / areas.sum())


def speeds(air: Jets, x: Array, h: Array | float = 0.0, arc: Array | float = 0.0) -> Array:
    """Return an upper bound on the air speed of every module in balls, shape (m, n) [m/s]; exact at h = arc = 0.

    Args:
        air: the jets of the modules.
        x: centres of the balls, shape (m, 3) [l_arm].
        h: radii of the balls, shape (m,) or a scalar [l_arm].
        arc: largest arc by which the balls are turned about a module's axis, shape (m,) or a scalar [l_arm].
    """
    balls = _balls(air, x, h, arc)
    return _speed(air, np.maximum(np.add(*_jet(air, balls)), _inflow(air, balls)))


def wakes(air: Jets, x: Array) -> Array:
    """Return the velocity of every module's jet without inflow at points (m, 3), shape (m, n, 3) [m/s].

    Its direction is the mean of slipstreams and merged jets, weighted by the squares of their speeds.
    """
    axes = np.broadcast_to(air.merged[1], air.rotors.shape)
    slipstreams, merged = (air.induced**2 * part for part in _jet(air, _balls(air, x)))
    flow = -np.einsum("mnq,nqi->mni", slipstreams, air.rotor_axes) - np.einsum("mnq,nqi->mni", merged, axes)
    speed = np.sqrt((slipstreams + merged).sum(axis=2))[..., None]
    return np.asarray(np.divide(flow, speed, out=np.zeros_like(flow), where=speed > 0))


class _Balls(NamedTuple):
    """Ranges of m balls relative to n modules, their merged jets and their rotors [l_arm]."""

    shallow: Array
    """Least depths below the starts of merged jets, shape (m, n, 1) or (m, n, r)."""
    deep: Array
    """Greatest depths, of that shape."""
    from_merged_axis: Array
    """Least distances from the axes of merged jets, of that shape."""
    above: Array
    """Least depths below the discs, shape (m, n, r)."""
    below: Array
    """Greatest depths, shape (m, n, r)."""
    from_rotor_axis: Array
    """Least distances from the rotors' axes, shape (m, n, r)."""
    from_disc: Array
    """Least distances from the discs, shape (m, n, r)."""


def _balls(air: Jets, x: Array, h: Array | float = 0.0, arc: Array | float = 0.0) -> _Balls:
    radius = np.broadcast_to(np.asarray(h, dtype=float), (len(x),))[:, None, None]
    turned = np.broadcast_to(np.asarray(arc, dtype=float), (len(x),))[:, None, None]
    sine = float(np.linalg.norm(air.axes[..., :2], axis=-1).max())
    z, from_axis = _depths_below(x, air.rotors, air.rotor_axes)
    depth, from_merged_axis = _depths_below(x, *air.merged)
    moved, sunk = radius + turned, radius + turned * sine
    merged, aside = (sunk, moved) if air.alone.any() else (radius, radius)
    return _Balls(
        shallow=depth - merged,
        deep=depth + merged,
        from_merged_axis=np.maximum(from_merged_axis - aside, 0.0),
        above=z - sunk,
        below=z + sunk,
        from_rotor_axis=np.maximum(from_axis - moved, 0.0),
        from_disc=np.maximum(np.hypot(np.maximum(from_axis - air.radii, 0.0), z) - moved, 0.0),
    )


def _depths_below(x: Array, starts: Array, axes: Array) -> tuple[Array, Array]:
    """Return depths of points, (m, 3), below starts along axes, (n, k, 3), and distances from the axes."""
    offset = x[:, None, None] - starts
    depth = -np.einsum("mnki,nki->mnk", offset, axes)
    return depth, np.linalg.norm(offset + depth[..., None] * axes, axis=3)


def _speed(air: Jets, factors: Array) -> Array:
    """Return speeds, shape (m, n) [m/s], from the factors of v_q^2, shape (m, n, r)."""
    return np.asarray(np.sqrt(np.einsum("nq,mnq->mn", air.induced**2, factors)))


def _inflow(air: Jets, balls: _Balls) -> Array:
    """Return a bound on H_q, shape (m, n, r)."""
    k = sink(air, balls.from_disc)
    return np.asarray(k * k.sum(axis=2, keepdims=True))


def sink(air: Jets, from_disc: Array) -> Array:
    """Return k at distances from the discs, shape (..., r)."""
    return np.asarray((air.shares > 0) * (1 + math.sqrt(2) * from_disc / air.radii) ** -2)


def _jet(air: Jets, balls: _Balls) -> tuple[Array, Array]:
    """Return bounds on the parts of G_q, of slipstreams and of merged jets, shape (m, n, r) each."""
    merged = air.shares * far_field(air, balls.shallow, balls.deep, balls.from_merged_axis)
    return (1 - _merged_share(air, balls.shallow)) * _slipstreams(air, balls) ** 2, merged


def far_field(air: Jets, shallow: Array, deep: Array, from_axis: Array) -> Array:
    """Return a bound on c M^2 between two depths at a distance of at least `from_axis`, shapes (..., k)."""
    L = air.diameters
    above, below = (np.maximum(z / L, MODEL.merged_at) + air.origin for z in (shallow, deep))
    profile = 1 + (math.sqrt(2) - 1) * (from_axis / (air.half_width * below * L)) ** 2
    return np.asarray(_merged_share(air, deep) * (air.decay / above / profile**2) ** 2)


def _merged_share(air: Jets, depth: Array) -> Array:
    s = depth / air.diameters
    return np.asarray(np.clip((s - MODEL.merged_at) / MODEL.merges_over + 1, 0.0, 1.0))


def _slipstreams(air: Jets, balls: _Balls) -> Array:
    """Return a bound on S_q, shape (m, n, r)."""
    above, below = (np.maximum(z, 0.0) for z in (balls.above, balls.below))
    g_above, g_below = (1 + z / np.hypot(air.radii, z) for z in (above, below))
    thin, wide = (MODEL.shear * (z + air.radii) for z in (above, below))
    inside = _outer_radius(wide, air.radii**2 / g_above) - balls.from_rotor_axis
    return np.where(balls.below >= 0, g_below * np.clip(inside / (2 * thin), 0.0, 1.0), 0.0)


def _outer_radius(delta: Array, a: Array) -> Array:
    core = 4 / 3 * delta + np.sqrt(np.maximum(a - 2 / 9 * delta**2, 0.0))
    return np.where(a >= 2 / 3 * delta**2, core, (24 * delta**2 * a) ** 0.25)
