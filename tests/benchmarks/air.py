"""Air over regions: the certified bound against samples, and the time it takes.

    python tests/benchmarks/air.py tests/designs/*.json [--points 1000000]

For each load case and region: largest of the sampled speeds, of the speeds the certificate found, and the bound.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from topo_search.model import Design
from topo_search.model.files import read_json
from verify.air import case_jets
from verify.air.bound import _points_in, bound_speed
from verify.air.jets import speeds
from verify.kinematics import platform
from verify.requirements import Scene


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("designs", nargs="+", type=Path)
    parser.add_argument("--points", type=int, default=1_000_000)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    print("design, load case, region: sampled, found, at most [m/s], bound over sample, seconds")
    for path in options.designs:
        design = read_json(Design, path)
        task, found = design.task, platform(design)
        scene = Scene(design, found)
        for case, blown in case_jets(design, found, scene):
            for number, requirement in enumerate(task.exposure):
                for _, region in scene.regions(requirement):
                    started = time.process_time()
                    bound = bound_speed(blown, region)
                    seconds = time.process_time() - started
                    sampled = 0.0
                    for scale in (0.1, 1.0, 3.0, 10.0, 30.0):
                        at = rng.choice([bound.point, scene.p_E, *scene.centres], options.points // 5)
                        points = _points_in(region, at + rng.normal(0, scale, at.shape))
                        sums = (speeds(blown, part).sum(axis=1) for part in np.array_split(points, 50))
                        sampled = max(sampled, *(float(part.max()) for part in sums))
                    ratio = bound.at_most / max(sampled, bound.found)
                    assert ratio >= 1
                    print(
                        f"{path.stem}, {case}, exposure {number}: {sampled:.4g}, {bound.found:.4g}, "
                        f"{bound.at_most:.4g}, {ratio:.4f}, {seconds:.3f}"
                    )


if __name__ == "__main__":
    main()
