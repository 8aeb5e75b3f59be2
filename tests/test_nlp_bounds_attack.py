"""Random tasks against the proofs: they are solved as if nothing were proven, and no design may contradict them.

`pytest -m slow tests/test_nlp_bounds_attack.py -s` prints the counts of the whole campaign.
"""

import math
from collections import Counter
from importlib import import_module

import numpy as np
import pytest
from nlp_cases import random_tree
from older import older_task

from nlp import lower_bound, prove_impossible, solve
from topo_search.model import Design, Status
from verify import audit

ALLOWANCE = 3e-6
"""Share of the bound by which a design may be under it: its wrenches are met to within the audit's tolerances."""


@pytest.fixture
def no_proofs(monkeypatch):
    """Nothing is refused unsolved, and no effort is held against the bound."""
    solver = import_module("nlp.solving")
    monkeypatch.setattr(solver, "prove_impossible", lambda *given: None)
    monkeypatch.setattr(solver, "bound_of", lambda *given: 0.0)


def random_module(rng, scale):
    """Any proportions: long arms, short connectors, rotors that end before, across and beyond the hinge."""
    l_arm = scale * rng.uniform(0.05, 0.3)
    module = {
        "arm_length": l_arm,
        "connector_distance": l_arm * (rng.uniform(0.3, 0.9) if rng.random() < 0.3 else rng.uniform(1.3, 2.5)),
        "mass": float(10 ** rng.uniform(-2, 1)),
        "max_thrust_to_weight": rng.uniform(1.5, 5.0),
        "airflow": {
            "start_radius": l_arm * rng.uniform(0.1, 0.8),
            "reach": l_arm * rng.uniform(2.0, 14.0),
            "spread_angle_deg": rng.uniform(0.0, 25.0),
        },
        "body": {
            "rotor_radius": l_arm * rng.uniform(0.1, 0.6),
            "rotor_height": l_arm * rng.uniform(0.02, 0.4),
            "hub": [l_arm * edge for edge in rng.uniform(0.1, 0.9, 3)],
            "arm_width": l_arm * rng.uniform(0.02, 0.2),
        },
    }
    return module if rng.random() < 0.6 else {"arm_length": 0.1 * scale, "connector_distance": 0.15 * scale}


def random_case(rng, push, newtons, metres):
    """About the platform's weight, at either place, with a torque or without; in weights or in SI."""
    force = rng.normal(size=3) * push + [0.0, 0.0, rng.uniform(0.3, 1.0)]
    torque = rng.normal(size=3) * push * rng.choice([0.0, 0.0, 0.1, 1.0])
    place = rng.choice(["com", "end_effector"])
    case = {"weight": float(10 ** rng.choice([0.0, rng.uniform(-15, 15), rng.uniform(-2, 2)]))}
    if rng.random() < 0.3:
        wrench = {"force": (newtons * force).tolist(), "torque": (newtons * metres * torque).tolist()}
        return {**case, "units": "SI", str(place): wrench}
    return {**case, str(place): {"force": force.tolist(), "torque": torque.tolist()}}


def random_task(rng, *, flies=False, counts_rod=False):
    """A task of one to four modules with any of the features that a proof reads; flight and walls if it flies."""
    scale, n = float(rng.choice([1.0, 1.0, 0.02, 30.0])), int(rng.choice([1, 2, 3, 4], p=[0.1, 0.2, 0.35, 0.35]))
    module = random_module(rng, scale)
    l_arm, n_cases = module["arm_length"], int(rng.choice([1, 1, 2, 2, 3, 6]))
    newtons, push = 9.81 * n * module.get("mass", 0.24), rng.choice([0.0, 0.05, 0.2, 0.8])
    exposure = [
        {"kind": "local", "radius": l_arm},
        {"kind": "directional", "radius": l_arm, "segments": [[6 * l_arm, 0.0, 0.0]]},
        {"kind": "exterior", "half_angle_deg": 80.0, "axis": "com"},
    ]
    end_effector = {
        "rod": "none",
        "largest_reach": False,
        "mass": float(module.get("mass", 0.24) * rng.uniform(0.01, 0.5)),
    }
    if rng.random() < 0.3:
        end_effector |= {"position": (rng.normal(size=3) * 2 * l_arm).tolist(), "exclusion": False}
        end_effector |= {"stand_off": l_arm * rng.uniform(0.5, 4.0)} if rng.random() < 0.5 else {}
    search = {
        "root": str(rng.choice(["free", "free", "paper"])),
        "connectors": str(rng.choice(["aligned", "any"])),
        "peak_input": float(rng.choice([1.0, 1.0, rng.uniform(0.5, 1.0)])),
        "margin": 1e-4 * scale,
    }
    if rng.random() < 0.3:
        search |= {"body_clearance": False}
    of_joints, of_inputs, of_rods = rng.spawn(3)
    if of_inputs.random() < 0.5:
        module["min_input"] = of_inputs.uniform(0.0, 0.15)
    if of_joints.random() < 0.5:
        module["joint_mass"] = float(module.get("mass", 0.24) * of_joints.uniform(0.0, 0.5))
    cases, flight = [random_case(rng, push, newtons, l_arm) for _ in range(n_cases)], {}
    task = {
        "name": "attack",
        "modules": n,
        "module": module,
        "end_effector": end_effector,
        "load_cases": cases,
        "exposure": [exposure[rng.integers(3)]] if rng.random() < 0.25 else [],
        "search": search,
    }
    if flies:
        flight = random_flight(rng, l_arm)
    if counts_rod:
        end_effector |= random_rod(of_rods, newtons / 9.81, l_arm)
        for case in cases:
            case["carries_weight"] = bool(of_rods.random() < 0.4)
        units = {"units": "SI", "force_reserve": 0.1 * newtons, "torque_reserve": 0.1 * newtons * l_arm}
        flight.get("flight", {}).update(
            {
                "com_error": 0.1 * l_arm,
                "tilt_deg": 5.0,
                "around": str(of_rods.choice(["hover", "all"])) if n_cases < 3 else "hover",
            },
            **(units if of_rods.random() < 0.5 else {}),
        )
    return older_task(task | flight).resolve(n)


def random_rod(rng, mass, l_arm):
    """A rod that counts, from weightless to half as heavy as a platform of some mass [kg]."""
    reach = l_arm * rng.uniform(0.5, 8.0)
    density = mass / reach * rng.choice([0.0, rng.uniform(0.0, 0.05), rng.uniform(0.0, 0.5)])
    return {
        "rod": "straight",
        "rod_mass": "included",
        "largest_reach": float(reach),
        "rod_linear_density": float(density),
    }


def random_flight(rng, l_arm):
    """Reserves and walls."""
    planes = [
        {"normal": rng.normal(size=3).tolist(), "offset": float(l_arm * rng.uniform(-1, 3))} for _ in range(2)
    ]
    walls = [
        {"kind": "allowed", "planes": planes[: int(rng.integers(1, 3))]},
        {"kind": "exterior", "half_angle_deg": 90.0, "axis": rng.normal(size=3).tolist()},
    ]
    flight = {
        "force_reserve": float(rng.choice([0.0, 0.1])),
        "directions": str(rng.choice(["all", "horizontal"])),
        "at": str(rng.choice(["tip", "com"])),
        "torque_reserve": float(rng.choice([0.0, 0.1])),
        "rotor_out": str(rng.choice(["none", "hover", "all"])),
    }
    return {"flight": flight, "exposure": [walls[rng.integers(2)]]}


def attack(seeds):
    """Solve a task for every seed, hold every proof against what came out, and count what that was."""
    counts = Counter()
    for seed in seeds:
        rng = np.random.default_rng([2024, seed])
        task = random_task(rng)
        tree = random_tree(task.n, rng, aligned=task.search.connectors == "aligned")
        bound, proof = lower_bound(task), prove_impossible(task, tree)
        assert math.isfinite(bound)
        result = solve(task, tree, starts=range(2), seed=seed)
        counts["tasks"] += 1
        counts["proven impossible"] += proof is not None
        if not isinstance(result, Design):
            continue
        clear = audit(result).verdict == Status.CLEAR
        counts["designs"] += 1
        counts["audited clear"] += clear
        counts["clear within 1 % of the bound"] += clear and result.objective < 1.01 * bound
        assert not (clear and proof is not None), f"seed {seed}: a clear design, but proven: {proof.message}"
        if clear:
            ratio = result.objective / bound if bound > 0 else math.inf
            assert ratio >= 1 - ALLOWANCE, f"seed {seed}: J is {ratio!r} of the bound"
    return counts


@pytest.mark.usefixtures("no_proofs")
def test_no_design_of_a_few_random_tasks_contradicts_a_proof():
    counts = attack(range(15))
    assert counts["audited clear"] >= 3
    assert counts["proven impossible"] >= 1


@pytest.mark.usefixtures("no_proofs")
def test_a_task_with_more_equations_than_unknowns_is_solved_like_any_other():
    """Ipopt does not begin then, and counts -1 iterations."""
    assert attack([206])["tasks"] == 1


@pytest.mark.slow
@pytest.mark.usefixtures("no_proofs")
def test_no_design_of_random_tasks_contradicts_a_proof():
    counts = attack(range(15, 240))
    print(dict(counts))
    assert counts["audited clear"] >= 50
    assert counts["proven impossible"] >= 25
