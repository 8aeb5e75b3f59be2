"""Vehicles with published figures."""

import math
from typing import Any

import numpy as np

from topo_search.model.vehicle import Vehicle


def rotor(r: Any, a: Any, **fields: Any) -> dict[str, Any]:
    """A rotor whose largest thrust is 1 N."""
    place = dict(zip(("x_m", "y_m", "z_m", "ax", "ay", "az"), [*map(float, r), *map(float, a)], strict=True))
    return {**place, "spin": 1, "k_f": 1.0, "k_tau": 0.0, "u_max": 1.0, **fields}


def star(tilt: float) -> Vehicle:
    """Six rotors on a circle, tilted about their arms, one to the left and one to the right."""
    rotors = []
    for k in range(6):
        c, s, t = math.cos(k * math.pi / 3), math.sin(k * math.pi / 3), tilt * (-1) ** k
        rotors.append(rotor([c, s, 0.0], [-s * math.sin(t), c * math.sin(t), math.cos(t)], spin=(-1) ** k))
    return Vehicle(rotors=rotors)


def omnicopter(drag: float) -> Vehicle:
    """Eight reversible rotors on the corners of a cube (Brescianini and D'Andrea, ICRA 2016), arms of 0.25 m."""
    a, b, c = 0.5 + 1 / math.sqrt(12), 0.5 - 1 / math.sqrt(12), 1 / math.sqrt(3)
    axes = np.array([[-a, b, -b, a, a, -b, b, -a], [b, a, -a, -b, -b, -a, a, b], [c, -c, -c, c, c, -c, -c, c]])
    x = [[1, -1, 1, -1, 1, -1, 1, -1], [1, 1, -1, -1, 1, 1, -1, -1], [1, 1, 1, 1, -1, -1, -1, -1]]
    at = 0.25 / math.sqrt(3) * np.array(x)
    rotors = [rotor(r, z, u_min=-1.0, k_tau=drag) for r, z in zip(at.T, axes.T, strict=True)]
    return Vehicle(rotors=rotors)


def hexacopter(spins: str, seed: int | None = None) -> Vehicle:
    """The usual hexacopter of 2.4 times its weight, or one with other drag, thrust and centre of mass."""
    rng = np.random.default_rng(seed)
    drag, thrust, com = (rng.uniform(0.005, 0.05), rng.uniform(0.3, 0.9), rng.normal(0, 0.03, 3))
    if seed is None:
        drag, thrust, com = 0.1 * 0.275, 6.125 / 15.043, np.zeros(3)
    rotors = [
        rotor([0.275 * math.cos(k * math.pi / 3), -0.275 * math.sin(k * math.pi / 3), 0.0], [0, 0, 1])
        | {"spin": 1 if spin == "p" else -1, "k_tau": drag, "u_max": thrust}
        for k, spin in enumerate(spins)
    ]
    return Vehicle(rotors=rotors, mass=1 / 9.81, com=tuple(com.tolist()))


HEXACOPTERS = {"pnpnpn": (0, 6), "ppnnpn": (4, 0)}
"""Failures after which roll, pitch and yaw are held, and after which only hover is (arXiv 1403.5986)."""
