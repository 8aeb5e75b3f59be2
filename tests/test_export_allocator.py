"""The allocator of a kit, against SciPy's linear programs and least squares."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from export_cases import random_design
from scipy.optimize import linprog, lsq_linear

from topo_search.export.allocation import Allocation, allocation, allocator_file
from topo_search.export.kit import write_kit
from topo_search.model import Design, Topology
from topo_search.model.files import read_json

SURVIVES = Path(__file__).parent / "designs/survives-a-rotor.json"


@pytest.fixture(scope="module")
def kit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown") / "kit"
    assert "allocator.py" in write_kit(read_json(Design, SURVIVES), folder).files
    return folder


def imported(path):
    spec = importlib.util.spec_from_file_location("allocator_of_a_kit", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", params=["kit", "with least inputs", "one module, of rank 4"])
def platform(request, tmp_path_factory, kit):
    """The file of a kit, and those of a platform whose rotors always run and of one that cannot push sideways."""
    if request.param == "kit":
        return imported(kit / "allocator.py")
    runs = request.param == "with least inputs"
    design = random_design(Topology.from_key("pa900" if runs else "a0"), 2, {"module": {"min_input": 0.05 * runs}})
    path = tmp_path_factory.mktemp("drawn") / "allocator.py"
    path.write_text(allocator_file(design, allocation(design)))
    return imported(path)


def cases(platform, rng):
    """Yield wrenches, limits and thrusts that exert them, or None where a linear program says there are none."""
    scale, N = np.array(platform.SCALE), len(platform.NAMES)
    B = np.array(platform.MATRIX)
    for i in range(40):
        high = np.array(platform.LARGEST)
        if i % 2:
            high[rng.integers(N)] = 0.0
        low = np.minimum(platform.LEAST, high)
        T = rng.uniform(low, high)
        corner = np.where(rng.random(N) < 0.5, low, high)
        mixed = np.where(rng.random(N) < 0.5, corner, T)
        yield from ((B @ each, low, high, each) for each in (T, corner, mixed))
        w, A, limits = rng.normal(size=6) / scale, scale[:, None] * B, np.stack([low, high], axis=1)
        w[2] = rng.uniform(0.5, 1.5) * platform.WEIGHT
        edge = linprog(-w @ np.diag(scale**2) @ B, bounds=limits).x  # thrusts of a corner of the reach
        for exerted in (edge, (edge + linprog(-rng.normal(size=6) @ A, bounds=limits).x) / 2):
            yield B @ exerted, low, high, exerted
        for size in (0.2, 1.0, 10.0):
            found = linprog(np.zeros(N), A_eq=A, b_eq=size * scale * w, bounds=limits)
            yield size * w, low, high, found.x if found.status == 0 else None


def test_wrenches_are_exerted_within_reach_and_nearest_beyond(platform):
    B, scale = np.array(platform.MATRIX), np.array(platform.SCALE)
    within = beyond = 0
    for w, low, high, known in cases(platform, np.random.default_rng(4)):
        T, missed = map(np.array, platform.allocate(w.tolist(), largest=high.tolist()))
        assert (low <= T).all()
        assert (high >= T).all()
        np.testing.assert_allclose(missed, w - B @ T, atol=1e-12 * np.abs(w).max())
        left = np.linalg.norm(scale * missed)
        if known is not None:
            within += 1
            assert left < 1e-9
            # of all thrusts that do it those nearest to the preferred ones, which are the least
            assert np.linalg.norm(T - platform.LEAST) <= np.linalg.norm(known - platform.LEAST) + 1e-6
        else:
            beyond += 1
            alive = high > 0
            A = scale[:, None] * B[:, alive]
            nearest = lsq_linear(A, scale * w, (low[alive], high[alive]), method="bvls", tol=1e-15, max_iter=999)
            assert left == pytest.approx(np.sqrt(2 * nearest.cost), abs=1e-9)
            np.testing.assert_allclose(scale * missed, scale * w - A @ nearest.x, atol=1e-6)
    assert within >= 200
    assert beyond > 50


def test_without_limits_in_the_way_thrusts_are_those_of_the_pseudo_inverse(platform):
    B, rng = np.array(platform.MATRIX), np.random.default_rng(5)
    preferred = np.full(B.shape[1], 0.5 * platform.FULL)
    for _ in range(50):
        w = B @ (preferred + rng.uniform(-0.2, 0.2, len(preferred)) * platform.FULL)
        T, _ = platform.allocate(w.tolist(), preferred=preferred.tolist())
        np.testing.assert_allclose(T, preferred + np.linalg.pinv(B, rcond=1e-9) @ (w - B @ preferred), atol=1e-7)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e30, 1e300])
def test_thrusts_are_within_limits_whatever_is_asked_for(platform, size):
    for sign in np.vstack([np.eye(6), -np.eye(6)]):
        T, _ = platform.allocate((size * sign).tolist())
        assert all(low <= x <= high for low, x, high in zip(platform.LEAST, T, platform.LARGEST, strict=True))


def test_the_file_has_the_kits_data_and_needs_python_alone(kit):
    acts, platform = read_json(Allocation, kit / "allocation.json"), imported(kit / "allocator.py")
    assert acts.thrust_matrix == platform.MATRIX
    assert tuple(rotor.name for rotor in acts.rotors) == platform.NAMES
    assert tuple(rotor.largest_thrust_N for rotor in acts.rotors) == platform.LARGEST
    assert acts.mass_kg * read_json(Design, SURVIVES).task.gravity == platform.WEIGHT
    hover = "from allocator import *; print(allocate((0, 0, WEIGHT, 0, 0, 0)))"
    alone = subprocess.run([sys.executable, "-S", "-c", hover], cwd=kit, capture_output=True, text=True, check=True)
    assert alone.stdout == f"{platform.allocate((0, 0, platform.WEIGHT, 0, 0, 0))}\n"


@pytest.mark.parametrize(
    "arguments", [{"wrench": (0, 0, float("nan"), 0, 0, 0)}, {"wrench": (0,) * 5}, {"largest": (1.0,)}]
)
def test_what_is_no_wrench_or_no_limit_is_refused(kit, arguments):
    with pytest.raises(ValueError, match=r"finite|argument"):
        imported(kit / "allocator.py").allocate(**{"wrench": (0.0,) * 6, **arguments})
