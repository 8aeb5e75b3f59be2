"""Closed-form bounds on maximised quantities, attacked by platforms that hold as much as a random descent finds."""

import math

import numpy as np
import pytest
from capability_cases import QUANTITIES, drawn, held, platform_at, task_of
from suites import few

from nlp import largest_value
from nlp.bounds.capability import AXES, ELEVATIONS, _mean_thrusts
from topo_search.model.maximized import provable_at


def climbed(task, rng, steps):
    """The most that platforms hold, from a random one by random steps, each kept if it is better."""
    towards = provable_at(task, 1.0).search.towards[::2]
    best, size, step = None, -1.0, 0.5
    for _ in range(steps):
        tree, theta, tip = drawn(task, rng)
        if best is not None:
            tree, theta, tip = best[0], best[1] + step * rng.normal(size=len(theta)), best[2] + step * tip
            theta[3:] = np.clip(theta[3:], -1.57, 1.57)
        found = held(task, platform_at(task, tree, theta, tip), towards)
        if found is not None and found > size:
            best, size = (tree, theta, tip), found
        else:
            step = max(0.01, 0.95 * step)
    return size


@pytest.mark.parametrize(
    ("quantity", "directions", "n", "seed"),
    few(
        [
            (q, d, n, seed)
            for q in QUANTITIES
            for d in ("horizontal", "all")
            for n in (1, 2, 3, 4)
            for seed in range(4)
        ],
        [(q, "horizontal", 3, 0) for q in QUANTITIES],
    ),
)
def test_no_platform_holds_more_than_the_bound(quantity, directions, n, seed):
    task = task_of(quantity, n, directions)
    assert climbed(task, np.random.default_rng([69, n, seed]), 60) <= largest_value(task)


def test_platforms_of_a_few_modules_come_close_to_some_bounds():
    """All axes up: nothing carries more. Three axes cannot be spread evenly, so a disc has some room."""
    payload = task_of("payload", 3, cases="hover")
    thrust = 3 * payload.max_thrust_to_weight * payload.module.mass
    assert largest_value(payload) == pytest.approx(thrust - payload.total_mass(3), rel=1e-3)
    disc = task_of("force_reserve", 3, cases="hover")
    assert 0.38 < largest_value(disc) / disc.force_unit(3) < 0.51


def test_axes_all_up_hold_no_sideways_force_and_two_modules_none_in_some_direction():
    for n in (1, 2):
        task = task_of("force_reserve", n)
        assert 0 < largest_value(task) < 1e-5 * task.force_unit(n)


@pytest.mark.parametrize("seed", range(3))
def test_the_mean_of_thrusts_is_that_of_samples(seed):
    rng = np.random.default_rng([70, seed])
    elevation, axis = rng.uniform(-math.pi / 2, math.pi / 2, size=2)
    angle = 2 * math.pi * np.arange(100_000) / 100_000
    products = math.cos(elevation) * math.cos(axis) * np.cos(angle) + math.sin(elevation) * math.sin(axis)
    assert _mean_thrusts(np.array(elevation), np.array(axis)) == pytest.approx(
        np.maximum(products, 0).mean(), abs=1e-8
    )
    assert len(ELEVATIONS) < len(AXES)
