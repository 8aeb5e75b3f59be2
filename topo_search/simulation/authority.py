"""Capability of the rotors in hover, before anything is flown: the reason why a flight fails is often there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from topo_search.model.arrays import Array
from topo_search.model.design import Design
from topo_search.simulation.controller import Allocator
from topo_search.simulation.plant import Nominal
from verify.air import air
from verify.kinematics import platform
from verify.requirements import Scene

MET = 1e-3
"""Largest residual of the hovering wrench by least squares, in weights and arm lengths times weights."""


def weakest_force(nominal: Nominal) -> tuple[float, Array]:
    """Return the least horizontal force that can be added to hover at the COM [N], and its direction, (3,).

    Each of the evenly spaced directions is a linear program over the thrusts.
    """
    forces, directions = [], 24
    for k in range(directions):
        angle = 2 * math.pi * k / directions
        d = np.array([math.cos(angle), math.sin(angle), 0.0])
        forces.append((load_factor(nominal, np.append(d, np.zeros(3))), k, d))
    force, _, d = min(forces, key=lambda one: one[:2])
    return force, d


def load_factor(nominal: Nominal, wrench: Array) -> float:
    """Return the largest factor of a wrench about the COM, (6,), that can be added to hover; inf of no wrench."""
    if not wrench.any():
        return math.inf
    N, W = nominal.B.shape[1], nominal.weight
    hover = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    scale = np.repeat([1.0, nominal.arm], 3) * W
    size = float(np.linalg.norm(wrench / scale))
    A = np.column_stack([nominal.B * nominal.largest_thrust / scale[:, None], -wrench / scale / size])
    bounds = [(nominal.least_share, 1)] * N + [(0, None)]
    solution = linprog(np.append(np.zeros(N), -1.0), A_eq=A, b_eq=hover, bounds=bounds)
    return float(solution.x[-1]) / size + 0.0 if solution.status == 0 else 0.0  # never -0.0


def hover_residual(nominal: Nominal, dead: int | None = None) -> tuple[float, float]:
    """Return what is missing of hover, in weights and arm lengths times weights, and the largest thrust's share."""
    allocator = Allocator(nominal)
    if dead is not None:
        allocator.stop_rotor(dead)
    T, missing = allocator.thrusts(np.array([0.0, 0.0, nominal.weight, 0.0, 0.0, 0.0]))
    short = np.abs(missing) / nominal.weight / np.repeat([1.0, nominal.arm], 3)
    return float(short.max()), float(T.max()) / nominal.largest_thrust


def hardest_rotor(nominal: Nominal) -> tuple[int, int]:
    """Return the rotor whose failure leaves least, and the number of single rotor failures that hover survives."""
    residuals = [hover_residual(nominal, rotor) for rotor in range(nominal.B.shape[1])]
    survived = sum(short <= MET for short, _ in residuals)
    worst = max(range(len(residuals)), key=lambda rotor: (max(residuals[rotor][0], MET), residuals[rotor][1]))
    return worst, survived


def wake_losses(design: Design) -> tuple[float, ...]:
    """Return the share of its thrust that each rotor loses to wakes, in the load case in which it loses most."""
    placed = platform(design)
    blown = air(design, placed, Scene(design, placed))
    if blown is None:
        return ()
    losses = ([rotor.thrust_loss for rotor in case.rotors] for case in blown.cases)
    return tuple(map(max, zip(*losses, strict=True)))


def tell_losses(nominal: Nominal, losses: tuple[float, ...]) -> str:
    """Return words for what wakes take, and whether that is more than the rotors have left in hover."""
    T, _ = Allocator(nominal).thrusts(np.array([0.0, 0.0, nominal.weight, 0.0, 0.0, 0.0]))
    lost = nominal.B @ (np.array(losses) * T)
    force, torque = np.linalg.norm(lost[:3]), np.linalg.norm(lost[3:])
    short, _ = hover_residual(replace(nominal, B=nominal.B * (1 - np.array(losses))))
    return (
        f"Wakes of other modules take up to {100 * max(losses):.2g} % of a rotor's thrust. In hover that is "
        f"{force:.2g} N and {torque:.2g} N m, {'more' if short > MET else 'less'} than the rotors can add."
    )
