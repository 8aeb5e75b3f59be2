"""Air in regions: certified speeds against samples, and the cost of speed limits and envelopes in a search.

    python tests/benchmarks/air.py certificate tests/designs/*.json [--points 1000000]
    python tests/benchmarks/air.py limits [--speeds 8 4 2 1]
    python tests/benchmarks/air.py speed push-local push-exterior-60 [--limit 1.0] [--modules 4]
    python tests/benchmarks/air.py slipstreams push-local ... [--modules 4]
    python tests/benchmarks/air.py front push-local [--speeds 2.6 2.4 2.2 2 1.9] [--modules 4]

`certificate`: for each load case and region the largest sampled speed, the largest speed that the certificate
found, and its bound. The other parts solve every tree once, in this process, with the default starts; effort is the
best tree's over the lower bound, and CPU time that of all trees over that of the first row. `limits`: four modules
hover, with the tip fixed 0.6 m below the centre of mass and a speed limit in a ball of 0.1 m, without geometry.
`speed`: a task with its envelopes, with a limit in addition, and with only the limit. `slipstreams`: a task whose
envelopes for regions start at l_arm, as between modules, and at l_arm + R. `front`: the front of effort against air
speed in the regions, by `goals.speed`.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from older import older_task

from nlp import default_starts, prepare, solve
from topo_search.compose import search
from topo_search.model import Design, Task
from topo_search.model.files import read_json
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates
from verify import audit
from verify.air.bound import _points_in, bound_speed, case_jets
from verify.air.jets import speeds
from verify.kinematics import platform
from verify.requirements import Scene


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parts = parser.add_subparsers(dest="part", required=True)
    certificate_parser = parts.add_parser("certificate")
    certificate_parser.add_argument("designs", nargs="+", type=Path)
    certificate_parser.add_argument("--points", type=int, default=1_000_000)
    parts.add_parser("limits").add_argument("--speeds", nargs="+", type=float, default=[8.0, 4.0, 2.0, 1.0])
    for name in ("speed", "slipstreams", "front"):
        search_parser = parts.add_parser(name)
        search_parser.add_argument("tasks", nargs="+")
        search_parser.add_argument("--modules", type=int, default=4)
        search_parser.add_argument("--limit", type=float, default=1.0)
        search_parser.add_argument("--speeds", nargs="+", type=float, default=[2.6, 2.4, 2.2, 2.0, 1.9])
    options = parser.parse_args()
    if options.part == "certificate":
        certificate(options)
    elif options.part == "limits":
        variants = {f"{speed:g} m/s": _below(speed=speed, geometry=False) for speed in options.speeds}
        compare({"envelopes": _below(), **variants}, 4)
    elif options.part == "front":
        for name in options.tasks:
            front(read_task(name, (f"modules={options.modules}", f"goals.speed={options.speeds}")))
    else:
        for name in options.tasks:
            compare(speed_variants(name, options) if options.part == "speed" else radii(name), options.modules)


def _below(**fields: object) -> Task:
    return older_task(
        name="below",
        modules=4,
        module={"torque_coefficient": 1.06e-8},
        end_effector={"position": [0.0, 0.0, -0.6], "rod": "none", "largest_reach": False},
        load_cases=[{"com": {"force": [0.0, 0.0, 1.0]}}],
        exposure=[{"kind": "local", "radius": 0.1, **fields}],
    )


def speed_variants(name: str, options: argparse.Namespace) -> dict[str, Task]:
    task, variants = read_task(name), {}
    for label, fields in (
        ("envelopes", {}),
        ("both", {"speed": options.limit}),
        (f"{options.limit:g} m/s", {"speed": options.limit, "geometry": False}),
    ):
        exposure = tuple(requirement.model_copy(update=fields) for requirement in task.exposure)
        variants[f"{name}, {label}"] = task.model_copy(update={"exposure": exposure})
    return variants


def radii(name: str) -> dict[str, Task]:
    return {
        f"{name}, l_arm": read_task(name, ("module.airflow.regions=false",)),
        f"{name}, l_arm + R": read_task(name, ("module.airflow.regions.spread_angle_deg=10.0",)),
    }


def front(task: Task) -> None:
    """Print the front of a task with goals, fastest air first."""
    with tempfile.TemporaryDirectory() as folder:
        points = search(task, out=folder, workers=1).front
    print(f"{task.name}: air over regions [m/s], effort over the bound, tree")
    for point in points.sort_values("speed", ascending=False).itertuples():
        print(f"{point.speed:.3f}, {point.objective / point.lower_bound:.4f}, {point.key}")


def compare(variants: dict[str, Task], n: int) -> None:
    """Solve all trees of n modules for each task, and print a row per task."""
    print("task: effort over the bound, tree, trees with a design, audit, air over regions [m/s], CPU of the first")
    first = None
    for label, task in variants.items():
        resolved, starts = task.resolve(n), range(default_starts(task))
        prepare(task, print)
        trees = [candidate.topology for candidate in candidates(n)]
        solve(resolved, trees[0], starts=range(1), seed=0)  # loads compiled code
        started = time.process_time()
        outcomes = [solve(resolved, tree, starts=starts, seed=0) for tree in trees]
        seconds = time.process_time() - started
        first = first or seconds
        designs = [design for design in outcomes if isinstance(design, Design)]
        if not designs:
            print(f"{label}: no design of {len(outcomes)} trees; {seconds / first:.2f}", flush=True)
            continue
        best = min(designs, key=lambda design: design.objective)
        judged = audit(best)
        speed = judged.air.region_m_s if judged.air else None
        print(
            f"{label}: {best.objective / best.lower_bound:.4f}, {best.topology_key}, "
            f"{len(designs)} of {len(outcomes)}, "
            f"{judged.verdict.value}, {speed if speed is None else format(speed, '.3f')}; {seconds / first:.2f}",
            flush=True,
        )


def certificate(options: argparse.Namespace) -> None:
    rng = np.random.default_rng(0)
    print("design, load case, region: sampled, found, at most [m/s], bound over sample, seconds")
    for path in options.designs:
        design = read_json(Design, path)
        task, placed = design.task, platform(design)
        scene = Scene(design, placed)
        for case, jets in case_jets(scene):
            for number, requirement in enumerate(task.exposure):
                for _, region in scene.regions(requirement):
                    started = time.process_time()
                    bound = bound_speed(jets, region)
                    seconds = time.process_time() - started
                    sampled = 0.0
                    for scale in (0.1, 1.0, 3.0, 10.0, 30.0):
                        centres = rng.choice([bound.point, scene.tip, *scene.centres], options.points // 5)
                        points = _points_in(region, centres + rng.normal(0, scale, centres.shape))
                        sums = (speeds(jets, part).sum(axis=1) for part in np.array_split(points, 50))
                        sampled = max(sampled, *(float(part.max()) for part in sums))
                    ratio = bound.at_most / max(sampled, bound.at_least)
                    assert ratio >= 1
                    print(
                        f"{path.stem}, {case}, exposure {number}: {sampled:.4g}, {bound.at_least:.4g}, "
                        f"{bound.at_most:.4g}, {ratio:.4f}, {seconds:.3f}"
                    )


if __name__ == "__main__":
    main()
