r"""The air that modules move: speeds of a jet model, and upper bounds of them over balls.

Lengths are in l_arm. A module with rotors q = 1..4, in its own frame, its jet along -z:

| symbol | meaning | unit |
|---|---|---|
| T_q, T | thrust of a rotor, k_f u_q; of the module, their sum | N |
| rho, R, L | density of air; rotor radius; distance of opposite rotors, 2 l_arm | kg/m^3, m, m |
| v_q | induced speed of a disc, sqrt(T_q / (2 rho pi R^2)) | m/s |
| U_H | that of four equal discs, sqrt(T / (8 rho pi R^2)) | m/s |
| s, r | depth below the centre and distance from the axis, in L | |
| z, d_q, r_q | depth; distance from disc q; distance from its axis | m |
| D, s_0, b | constants of the far field: decay, origin, half_width of `module.airflow.jet` | |
| s_F | depth at which the jets have merged, 2.5 | |

Three parts, of which the largest counts:

.. math::

    \text{far field} &= \min(1, s / s_F) \frac{D U_H}{s' + s_0}
        \Big(1 + (\sqrt 2 - 1) \frac{r^2}{b^2 (s' + s_0)^2}\Big)^{-2}, \quad s' = \max(s, s_F) \\
    \text{slipstream} &= v_q g(z) \min(1, (s_F - s) / 1.5) \,
        \mathrm{clip}\Big(\tfrac12 + \frac{R / \sqrt{g(z)} - r_q}{2 \delta(z)}, 0, 1\Big), \quad 0 \le s \le s_F \\
    \text{inflow} &= \sum_q v_q (1 + \sqrt 2 d_q / R)^{-2}

with g = 1 + z / sqrt(R^2 + z^2) and a shear layer of half width delta = 0.1 (z + R). The far field is that of
Bauersfeld et al., "Robotics meets Fluid Dynamics" (RA-L 2024, arXiv 2403.13321), measured for single quadrotors.
The slipstream is that of an actuator disc, narrowed by continuity to R / sqrt 2. The inflow is v_q at the disc and
a sink of half its flow, v_q R^2 / (2 d^2), far from it. Speeds are time averages in free air: no walls, no ground,
no wind; peaks of a jet are about 1.5 times as high.

All parts fall with r, r_q and d_q. A ball of radius h about x spans depths z - h to z + h and distances from r - h:
each factor at the end of its interval where it is largest bounds the speed in the ball. At h = 0 it is the speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model import Module
from verify.bodies import Array


class JetModel(NamedTuple):
    """Numbers of the air below a module."""

    merged_at: float = 2.5
    """s_F [L]."""
    fades_over: float = 1.5
    """Depths before s_F over which the rotors' slipstreams give way to the merged jet [L]."""
    shear: float = 0.1
    """Growth of the shear layer's half width."""
    diameter: float = 2.0
    """L [l_arm]."""


MODEL = JetModel()


class Jets(NamedTuple):
    """The air of some modules."""

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
        """Return those of all other modules."""
        return self._replace(
            centres=np.delete(self.centres, module, axis=0),
            poses=np.delete(self.poses, module, axis=0),
            rotors=np.delete(self.rotors, module, axis=0),
            induced=np.delete(self.induced, module, axis=0),
        )


def jets(
    module: Module, density: float, centres: Array, poses: Array, rotors: Array, squared_speeds: Array
) -> Jets:
    """Return the air of modules.

    Args:
        module: all of them.
        density: rho [kg/m^3].
        centres: shape (n, 3) [l_arm].
        poses: orientations, shape (n, 3, 3).
        rotors: centres of their discs, shape (n, 4, 3) [l_arm].
        squared_speeds: u, shape (n, 4) [rad^2/s^2]; those below zero count as zero.
    """
    thrusts = module.thrust_coefficient * np.maximum(squared_speeds, 0.0)
    radius, jet = module.body.rotor_radius, module.airflow.jet
    induced = np.sqrt(thrusts / (2 * density * math.pi * radius**2))
    R = radius / module.arm_length
    return Jets(centres, poses, rotors, R, induced, jet.decay, jet.origin, jet.half_width)


def speeds(air: Jets, x: Array, h: Array | float = 0.0) -> Array:
    """Return an upper bound of every module's air speed in balls; at h = 0 the speed itself.

    Args:
        air: the modules.
        x: centres of the balls, shape (m, 3) [l_arm].
        h: their radii, shape (m,), or one of all [l_arm].

    Returns:
        Shape (m, n) [m/s].
    """
    about = _about(air, x, h)
    return np.maximum(_wakes(air, about), _inflows(air, about))


def inflows(air: Jets, x: Array, h: Array | float = 0.0) -> Array:
    """Return the same of the air that discs draw in alone, (m, n) [m/s]."""
    return _inflows(air, _about(air, x, h))


def wakes(air: Jets, x: Array, h: Array | float = 0.0) -> Array:
    """Return the same without inflow: of the jets below the discs alone, (m, n) [m/s]."""
    return _wakes(air, _about(air, x, h))


class _Balls(NamedTuple):
    """Balls about points as modules and rotors see them [l_arm]."""

    radius: Array
    """Shape (m, 1)."""
    depth: Array
    """Depths of their centres below the discs, shape (m, n)."""
    beside: Array
    """Distances of their centres from the modules' axes, shape (m, n)."""
    from_axis: Array
    """Distances of their centres from the rotors' axes, shape (m, n, 4)."""


def _about(air: Jets, x: Array, h: Array | float) -> _Balls:
    offset = x[:, None] - air.centres
    depth = -np.einsum("mnx,nx->mn", offset, air.axes)
    to_rotor = x[:, None, None] - air.rotors + depth[..., None, None] * air.axes[:, None]
    return _Balls(
        radius=np.broadcast_to(np.asarray(h, dtype=float), (len(x),))[:, None],
        depth=depth,
        beside=np.linalg.norm(offset + depth[..., None] * air.axes, axis=2),
        from_axis=np.linalg.norm(to_rotor, axis=3),
    )


def _inflows(air: Jets, about: _Balls) -> Array:
    from_disc = np.hypot(np.maximum(about.from_axis - air.radius, 0.0), about.depth[..., None])
    least = np.maximum(from_disc - about.radius[..., None], 0.0)
    inflow = air.induced / (1 + math.sqrt(2) * least / air.radius) ** 2
    return np.asarray(inflow.sum(axis=2))


def _wakes(air: Jets, about: _Balls) -> Array:
    shallow, deep = about.depth - about.radius, about.depth + about.radius
    far = far_field(air, shallow, deep, np.maximum(about.beside - about.radius, 0.0))
    near = _slipstreams(air, shallow, deep, np.maximum(about.from_axis - about.radius[..., None], 0.0))
    return np.asarray(np.maximum(far, near.max(axis=2)))


def far_field(air: Jets, shallow: Array, deep: Array, beside: Array) -> Array:
    """Return a bound of the merged jets between two depths, no nearer to the axis than `beside`, (m, n)."""
    origin = air.origin
    least, most = (np.maximum(depth / MODEL.diameter, MODEL.merged_at) for depth in (shallow, deep))
    onset = np.clip(deep / MODEL.diameter / MODEL.merged_at, 0.0, 1.0)
    half_width = air.half_width * (most + origin) * MODEL.diameter
    profile = 1 + (math.sqrt(2) - 1) * (beside / half_width) ** 2
    return np.asarray(onset * air.decay * air.merged / (least + origin) / profile**2)


def _slipstreams(air: Jets, shallow: Array, deep: Array, beside: Array) -> Array:
    """Return a bound of each rotor's slipstream between two depths, (m, n, 4)."""
    R, end = air.radius, MODEL.merged_at * MODEL.diameter
    upper, lower = (np.clip(depth, 0.0, end)[..., None] for depth in (shallow, deep))
    growth_above, growth_below = (1 + z / np.hypot(R, z) for z in (upper, lower))
    inside = R / np.sqrt(growth_above) - beside
    width = 2 * MODEL.shear * (np.where(inside > 0, upper, lower) + R)
    fade = np.clip((end - upper) / (MODEL.fades_over * MODEL.diameter), 0.0, 1.0)
    profile = np.clip(0.5 + inside / width, 0.0, 1.0)
    return np.where(deep[..., None] >= 0, air.induced * growth_below * fade * profile, 0.0)
