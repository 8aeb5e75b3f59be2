"""Search with modules whose rotors are tilted about their arms, against X modules of the same mass and thrust.

    python tests/benchmarks/tilted.py [--tasks push:5,wall-push:4] [--tilts 0,5,10,20] [--starts N] [--separation]

Rotors of an X are tilted about their arms by alternate signs, so that the module has no side force at equal
thrusts. Prints a row per task and tilt: the least effort of a design with a clear audit, also over that of the X,
its tree, feasible trees, and what the audit says of the winner in hover: the largest horizontal force at the centre
of mass, the largest torque in any direction, and the load factor. With `--separation` no airflow is checked, as
tilts above 20 degrees require; exposure is then dropped.
"""

from __future__ import annotations

import argparse
import math
import time

from nlp import solve
from topo_search.model import Design
from topo_search.model.rotors import ModuleRotor
from topo_search.model.task import Task
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates
from verify import audit

HEAD = ("task", "n", "tilt [deg]", "tree", "J [rad^4/s^4]", "J over the X's", "feasible", "force [m_t g]")
HEAD += ("torque [l_arm m_t g]", "load factor", "CPU [s]")


MARGINS = (1e-3, 3e-3, 1e-2)
"""Margins tried where no audit is clear, as `run` does [m]."""


def tilted(task: Task, tilt_deg: float) -> Task:
    """Return the task with its X's rotors tilted about their arms by alternate signs."""
    a, s = math.radians(tilt_deg), task.module.arm_length / math.sqrt(2)
    rotors = list[ModuleRotor]()
    for q, (x, y) in enumerate(((s, -s), (-s, -s), (-s, s), (s, s))):
        lean = math.sin(a) * (-1) ** q / task.module.arm_length
        axis = (-y * lean, x * lean, math.cos(a))
        rotors.append(ModuleRotor(position=(x, y, 0.0), axis=axis, spin=1 if q % 2 == 0 else -1))
    return task.with_fields("module", rotors=tuple(rotors))


def row(name: str, n: int, tilt_deg: float, starts: int, separation: bool, reference: float | None) -> list[object]:
    """Return a row of the table."""
    settings = [f"modules={n}", "flight.defaults=false"]
    if separation:
        settings += ['search.interference="separation"', "exposure=[]"]
    user_task, started = tilted(read_task(name, tuple(settings)), tilt_deg), time.process_time()
    task = user_task.resolve(n)
    trees = [one.topology for one in candidates(n, symmetry="task", task=task)]
    for margin in (task.search.margin, *MARGINS):
        strict = user_task.with_fields("search", margin=margin).resolve(n)
        solved = (solve(strict, tree, starts=range(starts), seed=0) for tree in trees)
        designs = sorted((one for one in solved if isinstance(one, Design)), key=lambda design: design.objective)
        best = next(((one, found) for one in designs if (found := audit(one)).verdict == "clear"), None)
        if best is not None:
            break
    seconds = round(time.process_time() - started)
    if best is None:
        return [name, n, f"{tilt_deg:g}", "none", "", "", len(designs), "", "", "", seconds]
    design, found = best
    assert found.flight is not None
    hover, force_unit, torque_unit = found.flight.hover, task.force_unit(n), task.torque_unit(n)
    reserves = (hover.horizontal_reserve_com_N or 0.0) / force_unit, (hover.torque_reserve_Nm or 0.0) / torque_unit
    return [
        *(name, n, f"{tilt_deg:g}", design.topology.key, f"{design.objective:.4g}"),
        *(f"{design.objective / (reference or design.objective):.3f}", len(designs)),
        *(f"{reserve:.3f}" for reserve in reserves),
        *(f"{hover.load_factor or 0.0:.3f}", seconds),
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", default="push:5,wall-push:3")
    parser.add_argument("--tilts", default="0,5,10,15,20")
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--separation", action="store_true")
    options = parser.parse_args()
    print("| " + " | ".join(HEAD) + " |\n|" + "---|" * len(HEAD))
    for name, n in (part.split(":") for part in options.tasks.split(",")):
        reference = None
        for tilt in map(float, options.tilts.split(",")):
            cells = row(name, int(n), tilt, options.starts, options.separation, reference)
            reference = reference or (float(str(cells[4])) if cells[4] else None)
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)


if __name__ == "__main__":
    main()
