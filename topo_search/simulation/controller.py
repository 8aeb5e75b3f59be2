r"""Pose controller for a fully actuated platform, and its thrust allocation.

.. math::

    F &= m (g e_z - \omega_p^2 e_p - 2 \omega_p e_v - \omega_p^2 \tfrac{\omega_p}{8} \textstyle\int e_p) + F_k \\
    \tau &= J (-\omega_a^2 e_R - 2 \omega_a e_\omega - \omega_a^2 \tfrac{\omega_a}{8} \textstyle\int e_R)
            + \omega \times J \omega + \tau_k,
    \qquad e_R = \tfrac12 (R_d^T R - R^T R_d)^\vee

| symbol | meaning | shape | unit |
|---|---|---|---|
| e_p, e_v | errors of the COM's position and velocity, world axes | (3,) | m, m/s |
| e_R, e_omega | errors of attitude (T. Lee et al., CDC 2010) and rate, body axes | (3,) | rad, rad/s |
| omega_p, omega_a | bandwidths; both loops are critically damped, integral action is eight times slower | | rad/s |
| F_k, tau_k | feedforward of the wrench exerted on the environment, about the COM | (3,) | N, N m |
| a | acceleration asked for: the bracket of F without gravity; its horizontal part is limited to what the rotors
      can produce in hover in any direction, as autopilots do | (3,) | m/s^2 |
| s | thrusts over the largest, by bounded least squares | (N,) | |

The least squares scale forces by the weight m g and torques by l_arm m g, and weight torques ten times as much,
because a platform that loses its attitude loses its force direction as well. A small effort term makes the solution
unique:

.. math:: \min_{s_{min} \le s \le 1} \| Q (B T_{max} s - w) \|^2 + \epsilon \|s\|^2
"""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from topo_search.export.allocation import TORQUE_FIRST
from topo_search.model.arrays import Array
from topo_search.simulation.plant import Nominal, State, cross

INTEGRAL_RATIO = 8.0
"""Time constant of the integral action over that of the loop."""
EFFORT = 1e-6
"""epsilon."""
LARGEST_POSITION_ERROR, LARGEST_ATTITUDE_ERROR = 0.25, 0.35
"""Limits on the position [m] and attitude [rad] errors that are fed back, so that a return has bounded speed."""

INTEGRATION_DISTANCE, INTEGRATION_ANGLE = 0.02, 0.035
"""Largest errors that are integrated [m], [rad]: integrals compensate steady loads, not transients.

They need seconds to converge, and a mass error of 5 % moves the platform farther than INTEGRATION_DISTANCE. So
flights start trimmed, as after a hover in which the integrals have converged.
"""


@dataclass(frozen=True, eq=False)
class Reference:
    """Pose to hold at rest, and the wrench to exert there."""

    position: Array
    """Position of the COM, (3,) [m]."""
    wrench: Array
    """Wrench on the environment, about the COM, world axes, (6,)."""
    free: Array
    """Unit vector along which the contact determines the position, (3,); zero: none."""
    attitude: Array = field(default_factory=lambda: np.eye(3))
    """R_d, (3, 3); by default the task's axes."""

    def errors(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Return e_p without its component along `free`, and e_R, (3,) each."""
        R_error = self.attitude.T @ R
        skew = (R_error - R_error.T) / 2
        e_p = p - self.position
        return e_p - self.free * (self.free @ e_p), np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


@dataclass(eq=False)
class Controller:
    """The control law, from state to wrench."""

    nominal: Nominal
    period: float
    """[s]"""
    omega_p: float = 3.0
    omega_a: float = 8.0
    integral_p: Array = field(default_factory=lambda: np.zeros(3))
    integral_R: Array = field(default_factory=lambda: np.zeros(3))

    def wrench(self, state: State, reference: Reference) -> Array:
        """Return F in body axes and tau about the COM, (6,)."""
        p, v, R, omega = state
        m, J, wp, wa = self.nominal.mass, self.nominal.J, self.omega_p, self.omega_a
        projection = np.eye(3) - np.outer(reference.free, reference.free)
        e_p, e_R = reference.errors(p, R)
        e_p *= min(1.0, LARGEST_POSITION_ERROR / max(float(np.linalg.norm(e_p)), 1e-12))
        e_R *= min(1.0, LARGEST_ATTITUDE_ERROR / max(float(np.linalg.norm(e_R)), 1e-12))
        a = -(wp**2) * e_p - 2 * wp * v - wp**3 / INTEGRAL_RATIO * (projection @ self.integral_p)
        sideways = float(np.hypot(a[0], a[1]))
        if sideways > self.nominal.side_acceleration:
            a[:2] *= self.nominal.side_acceleration / sideways
        F = m * (a + np.array([0.0, 0.0, self.nominal.gravity])) + reference.wrench[:3]
        alpha = -(wa**2) * e_R - 2 * wa * omega - wa**3 / INTEGRAL_RATIO * self.integral_R
        tau = J @ alpha + cross(omega, J @ omega) + R.T @ reference.wrench[3:]
        return np.concatenate([R.T @ F, tau])

    def integrate(self, state: State, reference: Reference, is_produced: bool) -> None:
        """Integrate small errors, unless the rotors failed to produce the commanded wrench."""
        p, _, R, _ = state
        e_p, e_R = reference.errors(p, R)
        is_small = np.linalg.norm(e_p) < INTEGRATION_DISTANCE and np.linalg.norm(e_R) < INTEGRATION_ANGLE
        if is_produced and is_small:
            self.integral_p += self.period * e_p
            self.integral_R += self.period * e_R

    def trim(self, wrench: Array) -> None:
        """Add a wrench, (6,), to the output in level hover through the integrals."""
        m, J, wp, wa = self.nominal.mass, self.nominal.J, self.omega_p, self.omega_a
        self.integral_p -= INTEGRAL_RATIO / wp**3 / m * wrench[:3]
        self.integral_R -= INTEGRAL_RATIO / wa**3 * np.linalg.solve(J, wrench[3:])


class Allocator:
    """Allocation by least squares within the thrust limits."""

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
        """Bounds on the input of every rotor, over the largest thrust."""

    def stop_rotor(self, rotor: int) -> None:
        """Treat a rotor as dead from now on."""
        self.least[rotor] = self.largest[rotor] = 0.0

    def thrusts(self, wrench: Array) -> tuple[Array, Array]:
        """Return the thrusts (N,) [N], and the missing part of the wrench (6,)."""
        T = self.nominal.largest_thrust * np.clip(self._shares(self._scale * wrench), self.least, self.largest)
        return T, wrench - self.nominal.B @ T

    def _shares(self, scaled: Array) -> Array:
        """Return the thrusts over the largest, (N,), for a scaled wrench, (6,)."""
        g = -self._scaled.T @ scaled
        return np.asarray(self._solve(h=self._hessian, g=g, lbx=self.least, ubx=self.largest)["x"]).ravel()


class PseudoInverseAllocator(Allocator):
    """Allocation by the pseudo-inverse of the running rotors, clipped to the limits: PX4 with CA_METHOD 0."""

    def _shares(self, scaled: Array) -> Array:
        # relative to the largest, smaller singular values count as zero
        return np.asarray(np.linalg.pinv(self._scaled * (self.largest > 0), rcond=1e-9) @ scaled)
