r"""Jet model of the air that modules move: speeds at points, and upper bounds over balls.

Lengths are in l_arm. A module with rotors q = 1..4, in its own frame, with its jet along -z:

| symbol | meaning | unit |
|---|---|---|
| T_q, T | thrust of a rotor, k_f u_q; of the module, their sum | N |
| rho, R, L | density of air; rotor radius; distance between opposite rotors, 2 l_arm | kg/m^3, m, m |
| v_q | induced speed of a disc, sqrt(T_q / (2 rho pi R^2)) | m/s |
| U_H | induced speed of four equal discs, sqrt(T / (8 rho pi R^2)) | m/s |
| s, r | depth below the centre and distance from the axis, in L | |
| z, d_q, r_q | depth; distance from disc q; distance from its axis | m |
| D, s_0, b | constants of the far field: decay, origin, half_width of `module.airflow.jet` | |
| s_F | depth at which the jets have merged, 2.5 | |

The speed is the largest of three parts:

.. math::

    \text{far field} &= \min(1, s / s_F) \frac{D U_H}{s' + s_0}
        \Big(1 + (\sqrt 2 - 1) \frac{r^2}{b^2 (s' + s_0)^2}\Big)^{-2}, \quad s' = \max(s, s_F) \\
    \text{slipstream} &= v_q g(z) \min(1, (s_F - s) / 1.5) \,
        \mathrm{clip}\Big(\tfrac12 + \frac{R / \sqrt{g(z)} - r_q}{2 \delta(z)}, 0, 1\Big), \quad 0 \le s \le s_F \\
    \text{inflow} &= \sum_q v_q (1 + \sqrt 2 d_q / R)^{-2}

with g = 1 + z / sqrt(R^2 + z^2) and a shear layer of half-width delta = 0.1 (z + R). The far field is that of
Bauersfeld et al., "Robotics meets Fluid Dynamics" (RA-L 2024, arXiv 2403.13321), measured for single quadrotors.
The slipstream is that of an actuator disc, narrowed by continuity to R / sqrt 2. The inflow is v_q at the disc and
a sink of half its flow, v_q R^2 / (2 d^2), far from it. Speeds are time averages in free air, without walls, ground
or wind; peaks of a jet are about 1.5 times as high.

All parts decrease with r, r_q and d_q. A ball of radius h about x spans depths from z - h to z + h and distances
from r - h on. Evaluating each factor where it is largest in that range bounds the speed in the ball; at h = 0 the
bound is the speed itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model import Module
from verify.bodies import Array


class JetModel(NamedTuple):
    """Constants of the jet model."""

    merged_at: float = 2.5
    """s_F [L]."""
    fades_over: float = 1.5
    """Range of depth before s_F over which the rotors' slipstreams fade out [L]."""
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
    """Centres of the discs, shape (n, 4, 3) [l_arm]."""
    radius: float
    """R [l_arm]."""
    induced: Array
    """v_q, shape (n, 4) [m/s]."""
    decay: float
    origin: float
    half_width: float

    @property
    def axes(self) -> Array:
        """Thrust axes, shape (n, 3)."""
        return self.poses[:, :, 2]

    @property
    def merged(self) -> Array:
        """U_H, shape (n,) [m/s]."""
        return np.asarray(np.sqrt(np.mean(self.induced**2, axis=1)))

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
        rotors: centres of the discs, shape (n, 4, 3) [l_arm].
        squared_speeds: u, shape (n, 4) [rad^2/s^2]; negative values count as zero.
    """
    thrusts = module.thrust_coefficient * np.maximum(squared_speeds, 0.0)
    radius, jet = module.body.rotor_radius, module.airflow.jet
    induced = np.sqrt(thrusts / (2 * density * math.pi * radius**2))
    R = radius / module.arm_length
    return Jets(centres, poses, rotors, R, induced, jet.decay, jet.origin, jet.half_width)


def speeds(air: Jets, x: Array, h: Array | float = 0.0) -> Array:
    """Return an upper bound on the air speed of every module in balls, shape (m, n) [m/s]; exact at h = 0.

    Args:
        air: the jets of the modules.
        x: centres of the balls, shape (m, 3) [l_arm].
        h: radii of the balls, shape (m,) or a scalar [l_arm].
    """
    balls = _balls(air, x, h)
    return np.maximum(_wakes(air, balls), _inflows(air, balls))


def inflows(air: Jets, x: Array, h: Array | float = 0.0) -> Array:
    """Return the bound of `speeds` for the inflow only, the air that discs draw in, shape (m, n) [m/s]."""
    return _inflows(air, _balls(air, x, h))


def wakes(air: Jets, x: Array, h: Array | float = 0.0) -> Array:
    """Return the bound of `speeds` for the wakes only, the jets below the discs, shape (m, n) [m/s]."""
    return _wakes(air, _balls(air, x, h))


class _Balls(NamedTuple):
    """Coordinates of m balls relative to n modules and their rotors [l_arm]."""

    radius: Array
    """Radii, shape (m, 1)."""
    depth: Array
    """Depths of the centres below the discs, shape (m, n)."""
    from_module_axis: Array
    """Distances of the centres from the modules' axes, shape (m, n)."""
    from_rotor_axis: Array
    """Distances of the centres from the rotors' axes, shape (m, n, 4)."""


def _balls(air: Jets, x: Array, h: Array | float) -> _Balls:
    offset = x[:, None] - air.centres
    depth = -np.einsum("mnx,nx->mn", offset, air.axes)
    to_rotor = x[:, None, None] - air.rotors + depth[..., None, None] * air.axes[:, None]
    return _Balls(
        radius=np.broadcast_to(np.asarray(h, dtype=float), (len(x),))[:, None],
        depth=depth,
        from_module_axis=np.linalg.norm(offset + depth[..., None] * air.axes, axis=2),
        from_rotor_axis=np.linalg.norm(to_rotor, axis=3),
    )


def _inflows(air: Jets, balls: _Balls) -> Array:
    from_disc = np.hypot(np.maximum(balls.from_rotor_axis - air.radius, 0.0), balls.depth[..., None])
    nearest = np.maximum(from_disc - balls.radius[..., None], 0.0)
    inflow = air.induced / (1 + math.sqrt(2) * nearest / air.radius) ** 2
    return np.asarray(inflow.sum(axis=2))


def _wakes(air: Jets, balls: _Balls) -> Array:
    shallow, deep = balls.depth - balls.radius, balls.depth + balls.radius
    merged = far_field(air, shallow, deep, np.maximum(balls.from_module_axis - balls.radius, 0.0))
    from_axis = np.maximum(balls.from_rotor_axis - balls.radius[..., None], 0.0)
    return np.asarray(np.maximum(merged, _slipstreams(air, shallow, deep, from_axis).max(axis=2)))


def far_field(air: Jets, shallow: Array, deep: Array, from_axis: Array) -> Array:
    """Return a bound on the merged jets between two depths at a distance of at least `from_axis`, shape (m, n)."""
    origin = air.origin
    s_shallow, s_deep = (np.maximum(depth / MODEL.diameter, MODEL.merged_at) for depth in (shallow, deep))
    onset = np.clip(deep / MODEL.diameter / MODEL.merged_at, 0.0, 1.0)
    half_width = air.half_width * (s_deep + origin) * MODEL.diameter
    profile = 1 + (math.sqrt(2) - 1) * (from_axis / half_width) ** 2
    return np.asarray(onset * air.decay * air.merged / (s_shallow + origin) / profile**2)


def _slipstreams(air: Jets, shallow: Array, deep: Array, from_axis: Array) -> Array:
    """Return a bound on each rotor's slipstream between two depths, shape (m, n, 4)."""
    R, end = air.radius, MODEL.merged_at * MODEL.diameter
    upper, lower = (np.clip(depth, 0.0, end)[..., None] for depth in (shallow, deep))
    growth_above, growth_below = (1 + z / np.hypot(R, z) for z in (upper, lower))
    inside = R / np.sqrt(growth_above) - from_axis
    width = 2 * MODEL.shear * (np.where(inside > 0, upper, lower) + R)
    fade = np.clip((end - upper) / (MODEL.fades_over * MODEL.diameter), 0.0, 1.0)
    profile = np.clip(0.5 + inside / width, 0.0, 1.0)
    return np.where(deep[..., None] >= 0, air.induced * growth_below * fade * profile, 0.0)
