"""Wrenches of the rotors, compared with those that the load cases ask for (paper, Sec. II).

| symbol | meaning | shape | unit |
|---|---|---|---|
| u_k | squared rotor speeds of load case k | (n, 4) | rad^2/s^2 |
| A | wrench map about the COM, W_k = A u_k | (6, 4n) | N, N m per rad^2/s^2 |
| b_k | required wrench about the COM: force f_E + f_C, torque tau_E + p_E x f_E + tau_C | (6,) | N, N m |

Column (i, q) of A is k_f z_i over k_f o_iq x z_i + (-1)^q k_tau z_i. Gravity is a load case like any other.
"""

from __future__ import annotations

import numpy as np

from topo_search.model import Design, LoadCase, Module
from topo_search.model.arrays import ROTOR_SPINS
from verify.bodies import Array
from verify.kinematics import Platform


def wrench_map(platform: Platform, module: Module) -> Array:
    """Return A, shape (6, 4n), rotors module by module."""
    n = len(platform.o)
    z = np.broadcast_to(platform.poses.z[:, None, :], (n, 4, 3))
    force = module.thrust_coefficient * z
    drag = module.torque_coefficient * ROTOR_SPINS[None, :, None] * z
    torque = module.thrust_coefficient * np.cross(platform.rotors, z) + drag
    return np.concatenate([force, torque], axis=-1).reshape(4 * n, 6).T


def required_wrench(case: LoadCase, p_E: Array) -> Array:
    """Return b_k, shape (6,), of a load case in SI."""
    f_E, tau_E = np.array(case.at_end_effector.force), np.array(case.at_end_effector.torque)
    f_C, tau_C = np.array(case.at_com.force), np.array(case.at_com.torque)
    return np.concatenate([f_E + f_C, tau_E + np.cross(p_E, f_E) + tau_C])


def wrench_errors(design: Design, platform: Platform) -> Array:
    """Return what each load case's inputs produce beyond what it asks for, shape (K, 6) [N, N m]."""
    u = design.inputs.reshape(len(design.task.load_cases), -1)
    required = [required_wrench(case, platform.p_e) for case in design.task.load_cases]
    return np.asarray(u @ wrench_map(platform, design.task.module).T - np.array(required))


def objective(design: Design) -> float:
    """Return J = sum_k lambda_k ||u_k||^2 [rad^4/s^4]."""
    weights = np.array([case.weight for case in design.task.load_cases])
    return float(weights @ np.sum(design.inputs**2, axis=(1, 2)))
