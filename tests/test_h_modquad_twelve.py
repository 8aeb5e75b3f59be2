"""The published benchmark of modular design: twelve wrenches with the fewest H-ModQuad modules, level and flat."""

from collections import Counter

import numpy as np
import pytest
from scipy.optimize import linprog

from nlp import prove_impossible
from topo_search import search
from topo_search.model import Geometry, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies.lattices import lattices
from verify import complete
from verify.kinematics import platform, wrench_errors

CAPABLE = {4: 0, 5: 57, 6: 214}
"""Fixed polyominoes that can exert all wrenches; published: none of 19, 57 of 63, 214 of 216."""
WITH_CYCLES = {4: 0, 5: 8, 6: 42}
"""Those among them with cycles: all of 8 and 42, but not the one of four modules."""


def misses(topology: Topology) -> list[float]:
    """Return how far the nearest wrench is from each of the twelve: the largest component, over weight and arm.

    Linear programs over the thrusts, written down from `genConfig.py` alone.
    """
    task = read_task("h-modquad-twelve")
    corners, tilts = ((-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)), ((-1, 1), (-1, -1), (1, -1), (1, 1))
    centres = 0.4 * np.array([(*cell, 0.0) for cell in topology.cells])
    columns = []
    for centre in centres - centres.mean(axis=0):
        for k, ((a, b), tilt) in enumerate(zip(corners, tilts, strict=True)):
            x, y = np.radians(45) * np.array(tilt)
            axis = np.array([np.sin(y) * np.cos(x), -np.sin(x), np.cos(y) * np.cos(x)])
            rotor = centre - 0.2 * np.array([a, b, 0.0]) + [0.0, 0.0, 0.05]
            columns.append([*axis, *(np.cross(rotor, axis) + (-1) ** k * 0.001 * axis)])
    units = topology.n * 0.11 * 9.81 * np.repeat([1.0, 0.15], 3)
    A, slack, found = np.array(columns).T / units[:, None], -np.ones((6, 1)), list[float]()
    for case in task.load_cases:
        b = np.array([*case.at_com.force, *case.at_com.torque]) / units
        rows, limits = np.block([[A, slack], [-A, slack]]), [*b, *-b]
        bounds = [(0, 1)] * A.shape[1] + [(0, None)]
        found.append(linprog([*np.zeros(A.shape[1]), 1.0], A_ub=rows, b_ub=limits, bounds=bounds).fun)
    return found


@pytest.mark.parametrize("n", [4, 5])
def test_audit_proofs_and_linear_programs_find_the_published_numbers(n: int) -> None:
    """Solver and audit decide alike, lattice by lattice, and what is not capable is proven impossible."""
    task, found = read_task("h-modquad-twelve", (f"modules={n}",)), Counter[bool]()
    for lattice in (candidate.topology for candidate in lattices(n, "c1")):
        resolved = task.resolve(n).with_closures(len(lattice.closures))
        angles = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": (0.0,) * (n - 1)}
        bare = Geometry(task=resolved, topology=lattice, end_effector_m=(0.0, 0.0, 1.0), **angles)
        design = complete(bare)
        capable, missed = bool(np.abs(wrench_errors(design, platform(design))).max() < 1e-6), misses(lattice)
        assert capable == (max(missed) < 1e-9)
        proof = prove_impossible(resolved, lattice)
        assert capable == (proof is None)
        if proof is not None:
            case = resolved.case_labels.index(proof.worst_constraint.removesuffix(", wrench"))
            assert missed[case] * (1 - 1e-2) < proof.violation < missed[case]
        found[bool(lattice.closures)] += capable
    assert (found.total(), found[True]) == (CAPABLE[n], WITH_CYCLES[n])


@pytest.mark.slow
def test_a_run_says_that_five_modules_are_the_fewest_level_and_flat(tmp_path) -> None:
    answer = search(read_task("h-modquad-twelve", ("modules=[4,6]",)), out=tmp_path / "run", starts=1)
    assert [size.feasible for size in answer.sizes] == [*CAPABLE.values()]
    assert [size.impossible for size in answer.sizes] == [True, False, False]
    assert sum(size.statuses["impossible"] for size in answer.sizes) == 19 + 6 + 2
    assert answer.audit is not None
    assert answer.audit.verdict == "clear"


@pytest.mark.slow
def test_a_free_attitude_makes_four_more_pentominoes_capable(tmp_path) -> None:
    """Up to a half turn; the two straight ones are not."""
    free = read_task("h-modquad-twelve").replace(search={"lattice": "flat", "interference": "separation"})
    answer = search(free, out=tmp_path / "run")
    (size,) = answer.sizes
    assert (size.candidates, size.feasible) == (35, CAPABLE[5] + 4)
