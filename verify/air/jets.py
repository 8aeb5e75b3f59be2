r"""Jet model of the air that modules move: speeds at points, and upper bounds over balls.

Lengths are in l_arm. A module with rotors q = 1..r, in its own frame, with its jet along -z:

| symbol | meaning | unit |
|---|---|---|
| T_q | thrust of a rotor, k_f u_q | N |
| rho, R, L | density of air; rotor radius; distance between opposite rotors, 2 l_arm | kg/m^3, m, m |
| v_q | induced speed of a disc, sqrt(T_q / (2 rho pi R^2)) | m/s |
| s, r | depth below the centre and distance from the axis, in L | |
| z, d_q, r_q | depth; distance from disc q; distance from its axis | m |
| D, s_0, b | constants of the far field: decay, origin, half_width of `module.airflow.jet` | |
| c | share of the far field | |
| g | speed on a slipstream's axis over v_q | |
| delta, r_2 | half-width of a slipstream's shear layer, its outer radius | m |

The square of the speed is linear in the thrusts:

.. math::

    U^2 &= \sum_q v_q^2 \max\big(G_q, H_q\big), \qquad
    G_q = (1 - c) S_q^2 + \tfrac{c}{r} M^2, \quad c = \mathrm{clip}\big(\tfrac{s - 1}{1.5}, 0, 1\big) \\
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

Jets are straight; speeds are time averages in free air, without walls, ground or wind. Peaks of a jet are about 1.5
times as high. Swirl is left out: if it is as fast in all of a slipstream, a rotor's torque makes it
1.5 sqrt 2 k_tau / (k_f R) of the axial speed, which adds 6 % to the speed for the default module.

Bounds over a ball of radius h about x: it spans depths z_1 = z - h to z_2 = z + h and distances from r - h on. g,
delta and c grow with depth, a and D / (s' + s_0) fall; r_2 grows with delta and with a, in either case. S_q and k_q
fall with r_q and d_q, M with r and more slowly the deeper. So each factor is bounded where it is largest: c, g and
b (s' + s_0) at z_2, 1 - c and D / (s' + s_0) at z_1, r_2 by delta at z_2 and a at z_1, over delta at z_1. A ball
may also be turned about the module's axis by an arc: r and the depths stay, and r_q and d_q change by at most the
arc. At h = 0 the bound is the speed itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Module


class JetModel(NamedTuple):
    """Constants of the jet model."""

    merged_at: float = 2.5
    """Depth from which the far field is the whole jet [L]."""
    merges_over: float = 1.5
    """Range of depth before that over which slipstreams give way to it [L]."""
    shear: float = 0.1
    """Growth of the shear layer's half-width per depth."""
    diameter: float = 2.0
    """L [l_arm]."""


MODEL = JetModel()


class Jets(NamedTuple):
    """The jets of n modules."""

    centres: Array
    """Shape (n, 3) [l_arm]."""
    poses: Array
    """Orientations R_i, shape (n, 3, 3)."""
    rotors: Array
    """Centres of the discs, shape (n, r, 3) [l_arm]."""
    reach: float
    """Largest distance of a disc's centre from its module's [l_arm]."""
    radius: float
    """R [l_arm]."""
    induced: Array
    """v_q, shape (n, r) [m/s]."""
    decay: float
    origin: float
    half_width: float

    @property
    def axes(self) -> Array:
        """Thrust axes, shape (n, 3)."""
        return self.poses[:, :, 2]

    def drop(self, module: int) -> Jets:
        """Return the jets of all other modules."""
        return self._replace(
            centres=np.delete(self.centres, module, axis=0),
            poses=np.delete(self.poses, module, axis=0),
            rotors=np.delete(self.rotors, module, axis=0),
            induced=np.delete(self.induced, module, axis=0),
        )


def jets(
    module: Module, density: float, centres: Array, poses: Array, rotors: Array, squared_speeds: Array
) -> Jets:
    """Return the jets of equal modules.

    Args:
        module: the module's properties.
        density: rho [kg/m^3].
        centres: positions of the modules, shape (n, 3) [l_arm].
        poses: orientations, shape (n, 3, 3).
        rotors: centres of the discs, shape (n, r, 3) [l_arm].
        squared_speeds: u, shape (n, r) [rad^2/s^2]; negative values count as zero.
    """
    thrusts = module.thrust_coefficient * np.maximum(squared_speeds, 0.0)
    radius, jet = module.body.rotor_radius, module.airflow.jet
    induced = np.sqrt(thrusts / (2 * density * math.pi * radius**2))
    R, reach = radius / module.arm_length, float(module.rotor_table.distances.max())
    return Jets(centres, poses, rotors, reach, R, induced, jet.decay, jet.origin, jet.half_width)


def speeds(air: Jets, x: Array, h: Array | float = 0.0, arc: Array | float = 0.0) -> Array:
    """Return an upper bound on the air speed of every module in balls, shape (m, n) [m/s]; exact at h = arc = 0.

    Args:
        air: the jets of the modules.
        x: centres of the balls, shape (m, 3) [l_arm].
        h: radii of the balls, shape (m,) or a scalar [l_arm].
        arc: largest arc by which the balls are turned about a module's axis, shape (m,) or a scalar [l_arm].
    """
    balls = _balls(air, x, h, arc)
    return _speed(air, np.maximum(_jet(air, balls), _inflow(air, balls)))


def wakes(air: Jets, x: Array) -> Array:
    """Return the speed of every module's jet without inflow at points (m, 3), shape (m, n) [m/s]."""
    return _speed(air, _jet(air, _balls(air, x)))


class _Balls(NamedTuple):
    """Ranges of m balls relative to n modules and their rotors [l_arm]."""

    shallow: Array
    """Least depths below the discs, shape (m, n)."""
    deep: Array
    """Greatest depths, shape (m, n)."""
    from_module_axis: Array
    """Least distances from the modules' axes, shape (m, n)."""
    from_rotor_axis: Array
    """Least distances from the rotors' axes, shape (m, n, r)."""
    from_disc: Array
    """Least distances from the discs, shape (m, n, r)."""


def _balls(air: Jets, x: Array, h: Array | float = 0.0, arc: Array | float = 0.0) -> _Balls:
    offset = x[:, None] - air.centres
    depth = -np.einsum("mnx,nx->mn", offset, air.axes)
    to_rotor = x[:, None, None] - air.rotors + depth[..., None, None] * air.axes[:, None]
    from_rotor_axis = np.linalg.norm(to_rotor, axis=3)
    radius = np.broadcast_to(np.asarray(h, dtype=float), (len(x),))[:, None]
    moved = (radius[:, 0] + arc)[:, None, None]
    from_disc = np.hypot(np.maximum(from_rotor_axis - air.radius, 0.0), depth[..., None])
    return _Balls(
        shallow=depth - radius,
        deep=depth + radius,
        from_module_axis=np.maximum(np.linalg.norm(offset + depth[..., None] * air.axes, axis=2) - radius, 0.0),
        from_rotor_axis=np.maximum(from_rotor_axis - moved, 0.0),
        from_disc=np.maximum(from_disc - moved, 0.0),
    )


def _speed(air: Jets, shares: Array) -> Array:
    """Return speeds, shape (m, n) [m/s], from the factors of v_q^2, shape (m, n, r)."""
    return np.asarray(np.sqrt(np.einsum("nq,mnq->mn", air.induced**2, shares)))


def _inflow(air: Jets, balls: _Balls) -> Array:
    """Return a bound on H_q, shape (m, n, r)."""
    k = sink(air, balls.from_disc)
    return np.asarray(k * k.sum(axis=2, keepdims=True))


def sink(air: Jets, from_disc: Array) -> Array:
    """Return k at distances from a disc."""
    return np.asarray((1 + math.sqrt(2) * from_disc / air.radius) ** -2)


def _jet(air: Jets, balls: _Balls) -> Array:
    """Return a bound on G_q, shape (m, n, r)."""
    merged = far_field(air, balls.shallow, balls.deep, balls.from_module_axis)[..., None]
    return np.asarray((1 - _merged_share(balls.shallow))[..., None] * _slipstreams(air, balls) ** 2 + merged)


def far_field(air: Jets, shallow: Array, deep: Array, from_axis: Array) -> Array:
    """Return a bound on c M^2 / r between two depths at a distance of at least `from_axis`, all of one shape."""
    above, below = (np.maximum(z / MODEL.diameter, MODEL.merged_at) + air.origin for z in (shallow, deep))
    profile = 1 + (math.sqrt(2) - 1) * (from_axis / (air.half_width * below * MODEL.diameter)) ** 2
    return np.asarray(_merged_share(deep) / air.induced.shape[1] * (air.decay / above / profile**2) ** 2)


def _merged_share(depth: Array) -> Array:
    return np.asarray(np.clip((depth / MODEL.diameter - MODEL.merged_at) / MODEL.merges_over + 1, 0.0, 1.0))


def _slipstreams(air: Jets, balls: _Balls) -> Array:
    """Return a bound on S_q, shape (m, n, r)."""
    above, below = (np.maximum(z, 0.0)[..., None] for z in (balls.shallow, balls.deep))
    g_above, g_below = (1 + z / np.hypot(air.radius, z) for z in (above, below))
    thin, wide = (MODEL.shear * (z + air.radius) for z in (above, below))
    inside = _outer_radius(wide, air.radius**2 / g_above) - balls.from_rotor_axis
    return np.where(balls.deep[..., None] >= 0, g_below * np.clip(inside / (2 * thin), 0.0, 1.0), 0.0)


def _outer_radius(delta: Array, a: Array) -> Array:
    core = 4 / 3 * delta + np.sqrt(np.maximum(a - 2 / 9 * delta**2, 0.0))
    return np.where(a >= 2 / 3 * delta**2, core, (24 * delta**2 * a) ** 0.25)
