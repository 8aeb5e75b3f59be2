"""Update the gallery of the documentation from searches of all shipped tasks, and the picture of the README.

    python tests/benchmarks/keep_gallery.py [EXAMPLE ...]

Searches each task like `topo-search run EXAMPLE`, large ones with `--strategy optuna --trials 48`, and those with a
range of sizes with the fewest modules (`--modules 3`). The picture goes to
`notebooks/pictures/gallery-EXAMPLE.png`, the answer with the CPU time of all processes to
`notebooks/results/gallery.json`; entries of other tasks stay. An animation of the winner of `wall-push` goes to
`notebooks/pictures/turning.webp`.
"""

from __future__ import annotations

import argparse
import io
import json
import resource
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import topo_search
from topo_search.export.picture import Drawing, figure_of
from topo_search.export.poses import azimuth_deg, poses_to_draw
from topo_search.model import Design
from topo_search.model.files import read_json, write_atomically
from topo_search.model.task_file import examples, read_task
from verify.kinematics import Platform

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "notebooks/pictures"
RESULTS = ROOT / "notebooks/results/gallery.json"
EXHAUSTIVE_UP_TO = 8
"""Largest number of modules with which all trees are searched."""
TRIALS = 48
DPI = 110
ANIMATED = "wall-push"
FRAMES = 45
FRAME_MS = 90


def main() -> None:
    """Search, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", nargs="*", default=examples())
    for name in parser.parse_args().examples:
        before = _cpu_seconds()
        answer, design, options = search_shipped(name)
        if answer.best is None:
            raise SystemExit(f"{name}: no design to show; give it more trials")
        gallery = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
        gallery[name] = {
            "options": options,
            "key": answer.best.key,
            "modules": answer.best.modules,
            "candidates": sum(size.candidates for size in answer.sizes),
            "feasible": sum(size.statuses["feasible"] for size in answer.sizes),
            "gap": answer.best.gap,
            "claim": answer.objective.bound_words(answer.best),
            "audit": answer.best.audit,
            "cpu_seconds": round(_cpu_seconds() - before),
        }
        write_atomically(RESULTS, json.dumps(dict(sorted(gallery.items())), indent=1) + "\n")
        figure_of(design).savefig(PICTURES / f"gallery-{name}.png", dpi=DPI)
        if name == ANIMATED:
            write_atomically(PICTURES / "turning.webp", turning(design))
        print(name, gallery[name], flush=True)


def search_shipped(name: str, gap: float | None = None) -> tuple[topo_search.Answer, Design, str]:
    """Search a shipped task, and return the answer, its best design, and the options of the same command.

    Args:
        name: name of the task.
        gap: relative gap to prove by branch and bound; None: no proof.
    """
    task = read_task(name)
    strategy, options = dict[str, Any](), ""
    if not isinstance(task.modules, int):
        options = f" --modules {task.sizes[0]}"
        task = read_task(name, (f"modules={task.sizes[0]}",))
    elif task.modules > EXHAUSTIVE_UP_TO:
        strategy, options = {"strategy": "optuna", "trials": TRIALS}, f" --strategy optuna --trials {TRIALS}"
    with tempfile.TemporaryDirectory() as folder:
        answer = topo_search.search(task, out=Path(folder) / "run", prove=gap, **strategy)
        return answer, read_json(Design, Path(folder) / "run" / "best.json"), options


def turning(design: Design) -> bytes:
    """Return an animated picture of the platform with its airflow, turning once about the vertical."""
    platform = poses_to_draw(design)
    first = azimuth_deg(platform)
    views = [_draw(design, platform, first + 360 * k / FRAMES) for k in range(FRAMES)]
    zoom = 0.85 * min(zoom for _, _, zoom in views)  # it turns about a point that is not its middle
    frames = []
    for figure, scene, _ in views:
        low, high = np.array([getattr(scene.axes, f"get_{name}lim")() for name in "xyz"]).T
        scene.axes.set_box_aspect(tuple((high - low) / 2), zoom=zoom)
        scene.axes.set_position((0, 0, 1, 1))
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=100, facecolor="white")
        frames.append(Image.open(buffer).convert("RGB"))
    out = io.BytesIO()
    frames[0].save(out, "webp", save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, quality=70)
    return out.getvalue()


def _draw(design: Design, platform: Platform, azimuth: float) -> tuple[Figure, Drawing, float]:
    figure = Figure(figsize=(4.4, 4.4))
    scene = Drawing(figure.add_axes((0, 0, 1, 1), projection="3d"), design, platform, azimuth=azimuth)
    scene.axes.set_axis_off()
    scene.exposure()
    scene.airflow()
    scene.platform()
    return figure, scene, scene.finish()


def _cpu_seconds() -> float:
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    )


if __name__ == "__main__":
    main()
