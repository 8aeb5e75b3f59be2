"""Flight scenarios: where the platform starts, what it is asked, what pushes it, and what counts as held."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.model.load_case import LoadCase
from topo_search.simulation.plant import Nominal, Wall

BALANCED = 1e-6
"""Largest part of a load case's COM wrench that the weight leaves unbalanced [m_t g, l_arm m_t g]."""
APPROACH = 0.03
"""Gap between the tip and a wall at first [m]."""
RAMP = 1.5
"""In which a load is put on [s]."""
AWAY, TILT = 0.10, 10.0
"""Start of a return [m], [deg]."""
GUST_FORCE, GUST_TORQUE = 0.05, 0.02
"""Force and torque of a gust [m g], [l_arm m g]."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """One flight."""

    name: str
    seconds: float
    judged_from: float
    """From here on drift and tilt count [s]."""
    start: Array = field(default_factory=lambda: np.zeros(3))
    """Initial position of the COM [m]."""
    axis: Array = field(default_factory=lambda: np.zeros(3))
    """Unit vector about which the platform is tilted, at first or in its reference; zero: it is not."""
    tilt: float = 0.0
    """Tilt of the reference, ramped over RAMP from `ramp_at` on [deg]; 0: the platform begins tilted by TILT."""
    exerted: Array = field(default_factory=lambda: np.zeros(6))
    """Wrench on the environment at the end-effector, world axes, (6,), ramped over RAMP from `ramp_at` on."""
    ramp_at: float = 1.0
    gust: tuple[float, float] | None = None
    """From when to when [s]."""
    wind: Array = field(default_factory=lambda: np.zeros(6))
    """Wrench of the gust at the COM, world axes, (6,)."""
    wall: Wall | None = None
    dead: int | None = None
    """Rotor that dies at `dead_at`."""
    dead_at: float = 1.0
    largest_drift: float = 0.01
    """[m]"""
    largest_tilt: float = 2.0
    """[deg]"""
    counts: bool = True

    @property
    def force(self) -> float:
        """Size of the force that is asked for [N]."""
        return float(np.linalg.norm(self.exerted[:3]))

    def share_at(self, t: float) -> float:
        """Return how much of what is ramped is there at a time [s]."""
        return float(np.clip((t - self.ramp_at) / RAMP, 0.0, 1.0))


SIDES = {"+x": (1.0, 0.0), "+y": (0.0, 1.0), "-x": (-1.0, 0.0), "-y": (0.0, -1.0)}


def hover_scenarios() -> list[Scenario]:
    """Return hover, and returns from four sides, tilted about four axes."""
    scenarios = [Scenario("hover", 5.0, 1.0)]
    for name, (x, y) in SIDES.items():
        start, axis = AWAY * np.array([x, y, 0.0]), np.array([-y, x, 0.0])
        scenarios.append(Scenario(f"return from {name}", 5.0, 3.0, start=start, axis=axis))
    return scenarios


def tilts(size: float, *, counts: bool) -> list[Scenario]:
    """Return tilts of some size [deg] held about four axes."""
    return [
        Scenario(f"tilt about {name}", 5.0, 3.5, axis=np.array([x, y, 0.0]), tilt=size, ramp_at=0.5, counts=counts)
        for name, (x, y) in SIDES.items()
    ]


def gust(nominal: Nominal) -> Scenario:
    """Return a step of force and torque that lasts a second."""
    W = nominal.weight
    wind = np.array([GUST_FORCE * W, 0.0, 0.0, 0.0, 0.0, GUST_TORQUE * nominal.arm * W])
    return Scenario("gust", 6.0, 5.0, gust=(1.0, 2.0), wind=wind)


def dead_rotor(rotor: int, *, counts: bool) -> Scenario:
    """Return hover in which a rotor dies; what is lost of height and attitude has three seconds to heal."""
    name = f"rotor {rotor % 4} of module {rotor // 4} dies"
    return Scenario(name, 8.0, 4.0, dead=rotor, counts=counts)


def imbalance(design: Design, case: LoadCase) -> str | None:
    """Return why a load case is no steady flight; None if the weight is all that its COM wrench carries."""
    task, n = design.task, design.topology.n
    W, unit = task.force_unit(n), task.torque_unit(n)
    left = np.array(case.at_com.force) - [0.0, 0.0, W]
    turning = np.array(case.at_com.torque)
    if np.abs(left).max() <= BALANCED * W and np.abs(turning).max() <= BALANCED * unit:
        return None
    if np.abs(left).max() > BALANCED * W:
        a = ", ".join(f"{x:.2f}" for x in left / task.total_mass(n))
        return (
            "not a steady flight: the rotors' force, less the load and the weight, would accelerate "
            f"the platform by [{a}] m/s^2; to be flown, a case must carry the weight at the centre of mass"
        )
    return "not a steady flight: nothing reacts the torque at the centre of mass"


def exertion(case: LoadCase) -> Array:
    """Return what a load case exerts at the end-effector, (6,)."""
    return np.array([*case.at_end_effector.force, *case.at_end_effector.torque])


def hold_at_tip(name: str, case: LoadCase) -> Scenario | None:
    """Return a load case held against a load on the end-effector; None if it has none."""
    wrench = exertion(case)
    return Scenario(name, 6.0, 3.5, exerted=wrench) if wrench.any() else None


def hold(name: str, case: LoadCase, *, solid: bool = False) -> list[Scenario]:
    """Return a load case held against a load on the end-effector, and if it is a push, against a wall as well.

    All parts feel the wall. Parts are kept out of it where a region is solid: else it does not count.

    Args:
        name: of the load case.
        case: the load case.
        solid: whether the task has a solid region.
    """
    loaded = hold_at_tip(f"{name}, load at the tip", case)
    if loaded is None:
        return []
    scenarios, wrench = [loaded], loaded.exerted
    force = np.linalg.norm(wrench[:3])
    if force > 0 and not wrench[3:].any():
        touched = replace(loaded, name=f"{name}, wall", seconds=8.0, judged_from=5.5, ramp_at=3.0, counts=solid)
        scenarios.append(replace(touched, wall=Wall(wrench[:3] / force, APPROACH), largest_drift=0.02))
    return scenarios
