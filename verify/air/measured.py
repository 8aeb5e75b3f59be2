"""Air speeds of a design at its tip, over its regions and through its rotors.

A rotor loses LOSS of its thrust per m/s of wake along its axis: 0.04 to 0.06 s/m were measured of two quadrotors
one above the other (arXiv 2507.09463). Averages over a disc are of degree 5 (Abramowitz and Stegun, 25.4.61).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from topo_search.model import Design, Residual, Status
from topo_search.model.audit import AirSpeeds, CaseAir, RegionAir, RotorAir
from topo_search.model.exposure import Exposure
from verify.air.bound import SpeedBound, bound_speed
from verify.air.jets import Jets, jets, speeds, wakes
from verify.bodies import ball
from verify.fcl_queries import FARTHEST
from verify.kinematics import Platform
from verify.requirements import Scene
from verify.residuals import clamp

LOSS = 0.05
"""Share of its thrust that a rotor loses per m/s of wake along its axis [s/m]."""
DISC = math.sqrt(2 / 3) * np.array([(0.0, 0.0), *((np.cos(a), np.sin(a)) for a in np.arange(6) * math.pi / 3)])
"""Points of the unit disc, shape (7, 2)."""
WEIGHTS = np.array([2.0, *[1.0] * 6]) / 8
"""Their weights in its average, shape (7,)."""


def air(design: Design, platform: Platform, scene: Scene) -> AirSpeeds | None:
    """Return the air of a design in every load case; None if its numbers are too large to compute with."""
    if not (np.isfinite(design.inputs).all() and np.abs([*scene.centres, scene.p_E]).max() < FARTHEST):
        return None
    return AirSpeeds(cases=tuple(_case(name, scene, blown) for name, blown in case_jets(design, platform, scene)))


def case_jets(design: Design, platform: Platform, scene: Scene) -> Iterator[tuple[str, Jets]]:
    """Yield every load case's name and its jets, in the coordinates of the scene."""
    task = design.task
    rotors = scene.centres[:, None] + (platform.rotors - platform.o[:, None]) / scene.l_arm
    inputs = design.inputs.reshape(-1, len(scene.centres), 4)
    for name, u in zip(task.case_labels, inputs, strict=True):
        yield name, jets(task.module, task.air_density, scene.centres, platform.poses.R, rotors, u)


def speed_residuals(design: Design, measured: AirSpeeds | None) -> Iterator[Residual]:
    """Yield the air over every region whose speed is limited, in every load case: how far its bound is above."""
    for number, exposure in enumerate(design.task.exposure):
        if exposure.speed is None:
            continue
        for k, label in enumerate(design.task.case_labels):
            region = None if measured is None else measured.cases[k].regions[number]
            status = Status(region.status) if region is not None and region.status else Status.UNDECIDED
            at_most = math.inf if region is None else region.speed_at_most_m_s
            excess = 0.0 if status is Status.CLEAR else at_most - exposure.speed
            yield Residual(
                name=f"air over exposure {number} ({exposure.kind}), {label}",
                value=clamp(excess),
                unit="m/s",
                scaled=clamp(excess / exposure.speed),
                tolerance=0.0,
                status=status,
                stated=exposure.speed,
                derived=clamp(at_most),
            )


def _case(name: str, scene: Scene, blown: Jets) -> CaseAir:
    at_tip = speeds(blown, scene.p_E[None])[0]
    return CaseAir(
        name=name,
        tip_m_s=clamp(float(at_tip.sum())),
        tip_estimate_m_s=clamp(float(np.linalg.norm(at_tip))),
        regions=tuple(_region(number, one, scene, blown) for number, one in enumerate(scene.design.task.exposure)),
        rotors=tuple(_rotors(blown)),
    )


def _region(number: int, exposure: Exposure, scene: Scene, blown: Jets) -> RegionAir:
    limit, within = exposure.speed, exposure.speed_reach
    near = None if within is None else ball(scene.p_E, within / scene.l_arm)
    bounds = [
        bound_speed(blown, region, limit=math.inf if limit is None else limit, within=near)
        for _, region in scene.regions(exposure)
    ]
    largest = max(bounds, key=lambda bound: bound.at_least, default=SpeedBound(0.0, 0.0, scene.p_E))
    at_most = max((bound.at_most for bound in bounds), default=math.inf)
    status: Literal["clear", "undecided", "violated"] | None = None
    if limit is not None:
        status = "clear" if at_most <= limit else "violated" if largest.at_least > limit else "undecided"
    return RegionAir(
        name=f"exposure {number} ({exposure.kind})",
        speed_m_s=clamp(largest.at_least),
        speed_at_most_m_s=clamp(at_most),
        estimate_m_s=clamp(float(np.linalg.norm(speeds(blown, largest.point[None])))) if largest.at_least else 0.0,
        limit_m_s=limit,
        status=status,
    )


def _rotors(blown: Jets) -> list[RotorAir]:
    """Return what other modules' wakes do to every rotor."""
    rows = []
    for module, (R, discs) in enumerate(zip(blown.poses, blown.rotors, strict=True)):
        others = blown.drop(module)
        points = discs[:, None] + blown.radius * DISC @ R[:, :2].T
        through = WEIGHTS @ wakes(others, points.reshape(-1, 3)).reshape(4, len(DISC), len(others.centres))
        along = np.maximum(through @ (others.axes @ R[:, 2]), 0.0)
        rows += [
            RotorAir(
                module=module, rotor=q, ingested_m_s=clamp(float(sum_)), thrust_loss=min(1.0, LOSS * float(axial))
            )
            for q, (sum_, axial) in enumerate(zip(through.sum(axis=1), along, strict=True))
        ]
    return rows
