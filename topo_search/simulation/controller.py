r"""A pose controller for a platform that is fully actuated, and the thrusts that do what it asks.

.. math::

    F &= m (g e_z - \omega_p^2 e_p - 2 \omega_p e_v - \omega_p^2 \tfrac{\omega_p}{8} \textstyle\int e_p) + F_k \\
    \tau &= J (-\omega_a^2 e_R - 2 \omega_a e_\omega - \omega_a^2 \tfrac{\omega_a}{8} \textstyle\int e_R)
            + \omega \times J \omega + \tau_k,
    \qquad e_R = \tfrac12 (R_d^T R - R^T R_d)^\vee

| symbol | meaning | shape | unit |
|---|---|---|---|
| e_p, e_v | errors of the COM's position and velocity, world axes | (3,) | m, m/s |
| e_R, e_omega | errors of attitude (T. Lee et al., CDC 2010) and rate, body axes | (3,) | rad, rad/s |
| omega_p, omega_a | bandwidths: both loops are critically damped, integrals take eight times as long | | rad/s |
| F_k, tau_k | wrench that the environment takes up, fed forward, about the COM | (3,) | N, N m |
| s | thrusts over the largest; least squares with limits find them | (N,) | |

The least squares weigh forces by the weight m g and torques by l_arm m g, torques ten times as much, for a platform
that turns away loses its forces as well; a little effort is weighed so that the solution is unique:

.. math:: \min_{s_{min} \le s \le 1} \| Q (B T_{max} s - w) \|^2 + \epsilon \|s\|^2
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from topo_search.export.allocation import TORQUE_FIRST
from topo_search.model.arrays import Array
from topo_search.simulation.plant import Nominal, cross

INTEGRAL = 8.0
EFFORT = 1e-6
"""epsilon."""
LARGEST_POSITION_ERROR, LARGEST_ATTITUDE_ERROR = 0.25, 0.35
"""Errors of position [m] and attitude [rad] are cut off there, so that a far platform comes back at a set pace."""

LEARNING_DISTANCE, LEARNING_ANGLE = 0.02, 0.035
"""Errors up to which the integrals learn [m], [rad]: what they are for is a steady load, not the way back.

They take seconds, and a mass that is 5 % off takes the platform farther off than LEARNING_DISTANCE: so flights
begin trimmed, as after a hover in which they have learnt.
"""


@dataclass(frozen=True, eq=False)
class Reference:
    """Pose of the platform to hold at rest, and the wrench to exert there."""

    position: Array
    """Position of the COM, (3,) [m]."""
    wrench: Array
    """Exerted on the environment, about the COM, world axes, (6,)."""
    free: Array
    """Direction along which position is left to the contact, (3,); zero: none."""
    attitude: Array = field(default_factory=lambda: np.eye(3))
    """R_d, (3, 3); by default that of the task's axes."""

    def errors(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Return e_p of what counts of it, and e_R, (3,) each."""
        turned = self.attitude.T @ R
        off = (turned - turned.T) / 2
        away = p - self.position
        return away - self.free * (self.free @ away), np.array([off[2, 1], off[0, 2], off[1, 0]])


@dataclass(eq=False)
class Controller:
    """The loop from state to thrusts."""

    nominal: Nominal
    period: float
    """[s]"""
    omega_p: float = 3.0
    omega_a: float = 8.0
    integral_p: Array = field(default_factory=lambda: np.zeros(3))
    integral_R: Array = field(default_factory=lambda: np.zeros(3))

    def wrench(self, state: tuple[Array, Array, Array, Array], reference: Reference) -> Array:
        """Return F in body axes and tau about the COM, (6,)."""
        p, v, R, omega = state
        m, J, wp, wa = self.nominal.mass, self.nominal.J, self.omega_p, self.omega_a
        kept = np.eye(3) - np.outer(reference.free, reference.free)
        e_p, e_R = reference.errors(p, R)
        e_p *= min(1.0, LARGEST_POSITION_ERROR / max(float(np.linalg.norm(e_p)), 1e-12))
        e_R *= min(1.0, LARGEST_ATTITUDE_ERROR / max(float(np.linalg.norm(e_R)), 1e-12))
        a = -(wp**2) * e_p - 2 * wp * v - wp**3 / INTEGRAL * (kept @ self.integral_p)
        F = m * (a + np.array([0.0, 0.0, self.nominal.gravity])) + reference.wrench[:3]
        turned = -(wa**2) * e_R - 2 * wa * omega - wa**3 / INTEGRAL * self.integral_R
        tau = J @ turned + cross(omega, J @ omega) + R.T @ reference.wrench[3:]
        return np.concatenate([R.T @ F, tau])

    def learn(self, state: tuple[Array, Array, Array, Array], reference: Reference, met: bool) -> None:
        """Integrate small errors, unless the rotors did not do what was asked."""
        p, _, R, _ = state
        e_p, e_R = reference.errors(p, R)
        if met and np.linalg.norm(e_p) < LEARNING_DISTANCE and np.linalg.norm(e_R) < LEARNING_ANGLE:
            self.integral_p += self.period * e_p
            self.integral_R += self.period * e_R

    def trim(self, lacking: Array) -> None:
        """Let the integrals ask for so much more in hover, level, (6,)."""
        m, J, wp, wa = self.nominal.mass, self.nominal.J, self.omega_p, self.omega_a
        self.integral_p -= INTEGRAL / wp**3 / m * lacking[:3]
        self.integral_R -= INTEGRAL / wa**3 * np.linalg.solve(J, lacking[3:])


class Allocator:
    """Thrusts within limits that come as close as can be to a wrench."""

    def __init__(self, nominal: Nominal) -> None:
        self.nominal = nominal
        N = nominal.B.shape[1]
        scale = np.repeat([1.0, TORQUE_FIRST / nominal.arm], 3) / nominal.weight
        self._scaled = scale[:, None] * nominal.B * nominal.largest_thrust
        self._scale = scale
        self._hessian = ca.DM(self._scaled.T @ self._scaled + EFFORT * np.eye(N))
        shapes = {"h": ca.Sparsity.dense(N, N), "a": ca.Sparsity(0, N)}
        self._solve = ca.conic("allocate", "daqp", shapes, {"print_time": False})
        self.least, self.largest = np.full(N, nominal.least_share), np.ones(N)
        """Shares between which every rotor runs."""

    def stop_rotor(self, rotor: int) -> None:
        """Take a rotor for dead from now on."""
        self.least[rotor] = self.largest[rotor] = 0.0

    def thrusts(self, wrench: Array) -> tuple[Array, Array]:
        """Return the thrusts (N,) [N], and what is missing of the wrench (6,)."""
        g = -self._scaled.T @ (self._scale * wrench)
        solution = self._solve(h=self._hessian, g=g, lbx=self.least, ubx=self.largest)
        T = self.nominal.largest_thrust * np.clip(np.asarray(solution["x"]).ravel(), self.least, self.largest)
        return T, wrench - self.nominal.B @ T


class PseudoInverse(Allocator):
    """Thrusts by the pseudo-inverse of what runs, each cut off at its limits: PX4's with CA_METHOD 0."""

    def thrusts(self, wrench: Array) -> tuple[Array, Array]:
        """Return the thrusts (N,) [N], and what is missing of the wrench (6,)."""
        full = self.nominal.largest_thrust
        # singular values below a share of the largest are zero
        shares = np.linalg.pinv(self._scaled * (self.largest > 0), rcond=1e-9) @ (self._scale * wrench)
        T = full * np.clip(shares, self.least, self.largest)
        return T, wrench - self.nominal.B @ T
