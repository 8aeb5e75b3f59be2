"""Flight scenarios: initial state, reference, disturbance, and the limits of success."""

from dataclasses import dataclass, field, replace

import numpy as np

from topo_search.model import Array, Design, LoadCase, ResolvedTask
from topo_search.simulation.plant import Nominal, Wall
from verify.kinematics import has_rotor

BALANCE_TOLERANCE = 1e-6
"""Largest unbalanced part of a load case's COM wrench in a steady flight [m_t g, l_arm m_t g]."""
APPROACH = 0.03
"""Initial gap between the tip and a wall [m]."""
RAMP_TIME = 1.5
"""Time over which a load or a tilt is applied [s]."""
OFFSET, TILT = 0.10, 10.0
"""Initial errors of a return [m], [deg]."""
GUST_FORCE, GUST_TORQUE = 0.05, 0.02
"""Force and torque of a gust [m g], [l_arm m g]."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """One flight."""

    name: str
    seconds: float
    judged_from: float
    """Time from which drift and tilt count [s]."""
    start: Array = field(default_factory=lambda: np.zeros(3))
    """Initial position of the COM [m]."""
    axis: Array = field(default_factory=lambda: np.zeros(3))
    """Unit axis of the initial tilt or of the reference's tilt, (3,); zero: no tilt."""
    tilt: float = 0.0
    """Tilt of the reference, ramped up over RAMP_TIME from `ramp_at` [deg]; 0: the initial tilt is TILT instead."""
    exerted: Array = field(default_factory=lambda: np.zeros(6))
    """Wrench on the environment at the end-effector, world axes, (6,), ramped up over RAMP_TIME from `ramp_at`."""
    ramp_at: float = 1.0
    gust: tuple[float, float] | None = None
    """Start and end of the gust [s]."""
    wind: Array = field(default_factory=lambda: np.zeros(6))
    """Wrench of the gust at the COM, world axes, (6,)."""
    wall: Wall | None = None
    dead: int | None = None
    """Rotor that fails at `dead_at`."""
    dead_at: float = 1.0
    largest_drift: float = 0.01
    """[m]"""
    largest_tilt: float = 2.0
    """[deg]"""
    counts: bool = True

    @property
    def force(self) -> float:
        """Magnitude of the required force [N]."""
        return float(np.linalg.norm(self.exerted[:3]))

    def share_at(self, t: float) -> float:
        """Return the share of the ramped load or tilt at a time [s]."""
        return float(np.clip((t - self.ramp_at) / RAMP_TIME, 0.0, 1.0))


SIDES = {"+x": (1.0, 0.0), "+y": (0.0, 1.0), "-x": (-1.0, 0.0), "-y": (0.0, -1.0)}


def hover_scenarios(*, counts: bool) -> list[Scenario]:
    """Return hover, and returns from four sides with initial tilt; `counts`: whether these count."""
    scenarios = [Scenario("hover", 5.0, 1.0)]
    for name, (x, y) in SIDES.items():
        start, axis = OFFSET * np.array([x, y, 0.0]), np.array([-y, x, 0.0])
        scenarios.append(Scenario(f"return from {name}", 5.0, 3.0, start=start, axis=axis, counts=counts))
    return scenarios


def tilts(size: float, *, counts: bool) -> list[Scenario]:
    """Return scenarios that hold a tilt of a given size [deg] about each of four axes."""
    return [
        Scenario(f"tilt about {name}", 5.0, 3.5, axis=np.array([x, y, 0.0]), tilt=size, ramp_at=0.5, counts=counts)
        for name, (x, y) in SIDES.items()
    ]


def gust(nominal: Nominal, *, counts: bool) -> Scenario:
    """Return hover in a gust: a step of force and torque that lasts a second."""
    W = nominal.weight
    wind = np.array([GUST_FORCE * W, 0.0, 0.0, 0.0, 0.0, GUST_TORQUE * nominal.arm * W])
    return Scenario("gust", 6.0, 5.0, gust=(1.0, 2.0), wind=wind, counts=counts)


def dead_rotor(rotor: int, task: ResolvedTask, *, counts: bool) -> Scenario:
    """Return hover in which a rotor fails, with three seconds to recover height and attitude."""
    i, q = np.argwhere(has_rotor(task))[rotor].tolist()
    return Scenario(f"rotor {q} of module {i} dies", 8.0, 4.0, dead=rotor, counts=counts)


def imbalance(design: Design, case: LoadCase) -> str | None:
    """Return the reason why a load case is not a steady flight; None if its COM wrench balances the weight."""
    task, n = design.task, design.topology.n
    W, unit = task.force_unit(n), task.torque_unit(n)
    force = np.array(case.at_com.force) - [0.0, 0.0, W]
    torque = np.array(case.at_com.torque)
    if np.abs(force).max() > BALANCE_TOLERANCE * W:
        a = ", ".join(f"{x:.2f}" for x in force / task.total_mass(n))
        return (
            "not a steady flight: the rotors' force, less the load and the weight, would accelerate "
            f"the platform by [{a}] m/s^2; to be flown, a case must carry the weight at the centre of mass"
        )
    if np.abs(torque).max() > BALANCE_TOLERANCE * unit:
        return "not a steady flight: nothing reacts the torque at the centre of mass"
    return None


def tip_wrench(case: LoadCase) -> Array:
    """Return the wrench of a load case at the end-effector, (6,)."""
    return np.array([*case.at_end_effector.force, *case.at_end_effector.torque])


def hold_at_tip(name: str, case: LoadCase) -> Scenario | None:
    """Return a load case held against the load on the end-effector; None if the load is zero."""
    wrench = tip_wrench(case)
    return Scenario(name, 6.0, 3.5, exerted=wrench) if wrench.any() else None


def hold(name: str, case: LoadCase, *, solid: bool = False, pulls: bool = False) -> list[Scenario]:
    """Return a load case held against the load on the end-effector, and a pure push against a wall as well.

    All parts collide with the wall. Only a solid region keeps parts away from it, so otherwise it does not count.

    Args:
        name: name of the load case.
        case: the load case.
        solid: whether the task has a solid region.
        pulls: whether the object is behind the end-effector, so that there is no wall to push against.
    """
    loaded = hold_at_tip(f"{name}, load at the tip", case)
    if loaded is None:
        return []
    scenarios, wrench = [loaded], loaded.exerted
    force = np.linalg.norm(wrench[:3])
    if force > 0 and not wrench[3:].any() and not pulls:
        pressing = replace(loaded, name=f"{name}, wall", seconds=8.0, judged_from=5.5, ramp_at=3.0, counts=solid)
        scenarios.append(replace(pressing, wall=Wall(wrench[:3] / force, APPROACH), largest_drift=0.02))
    return scenarios
