"""`topo-search airflow`, `capability` and `kit`: airflow of a module, capability of a vehicle, common brackets."""

from pathlib import Path
from typing import Any
from warnings import catch_warnings

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command, note
from topo_search.limits import LIMITS


@command(epilog="Example: topo-search capability kit/rotors.csv")
@click.argument("vehicle", metavar="VEHICLE.toml|rotors.csv")
@click.option("--task", "judge", metavar="TASK", help="Judge the vehicle against the load cases of this task.")
@options.out("--out", "page", "Also write the figures as an .html page.")
@options.as_json
def capability(vehicle: str, judge: str | None, page: Path | None) -> None:
    """Prove what any vehicle with fixed rotors can do, as the audit does for a design.

    \b
    rotors.csv    as in a kit, a row per rotor: x_m, y_m, z_m from the centre of mass, its thrust axis axis_x,
                  axis_y, axis_z, spin (1 counter-clockwise seen against its thrust, else -1),
                  thrust_coefficient_Ns2, torque_coefficient_Nms2, largest_thrust_N and, if it is not 0,
                  u_min (least squared speed; below 0: reversible)
    VEHICLE.toml  mass, inertia, com, end_effector, gravity and rotors = "rotors.csv"

    A table alone is judged with a mass of 1 kg. The task's loads act at the vehicle's end-effector, and its units
    of weight are the vehicle's weight.

    Exit status: 0 done; 1 a load case of the task is not proven possible; 2 bad input.
    """  # noqa: D301 (\b is click's)
    from topo_search.export.audits import flight_lines, forces_without_torque
    from topo_search.model.files import write_atomically
    from topo_search.model.vehicle import read_vehicle

    options.require_writable(page)
    loaded = read_vehicle(vehicle)
    result = ts.capability(vehicle, judge)
    if page is not None:
        from topo_search.report.design_page import vehicle_page

        write_atomically(page, vehicle_page(Path(vehicle).name, len(loaded.rotors), result))
    verdicts = {True: "possible", False: "impossible", None: "undecided"}
    lines = [
        f"{vehicle}: {len(loaded.rotors)} rotors, rank {result.rank} of 6",
        *(f"  {line}" for line in forces_without_torque(result)),
        *(f"  {line.replace(' of module 0', '')}" for line in flight_lines(result.flight)),
        *(f"  {case.name}: {verdicts[case.possible]}" for case in result.flight.cases[1:]),
    ]
    options.echo_answer(result.model_dump(mode="json"), lines)
    if result.met is False:
        raise SystemExit(1)


@command(epilog="Example: topo-search airflow push-local --speed 2 --at full")
@click.argument("task", required=False)
@options.real_number(
    "--speed", (1e-6, None), "Air speed that the envelope encloses [m/s].", required=True, metavar="V"
)
@click.option(
    "--at",
    default="hover",
    metavar="hover|full|T",
    help="Thrust of the module: its weight, its largest thrust, or a multiple of its weight.",
)
@options.as_json
def airflow(task: str | None, speed: float, at: str) -> None:
    """Compute the smallest cone-sphere around all air of one module that is at least as fast as V.

    Prints start_radius, spread_angle_deg and reach for [module.airflow], and the largest air speeds on the module's
    present envelope. That no air outside is that fast is proven for the jet model: time averages, one module in
    free air. No cone-sphere around that air is more than 1 % smaller.

    TASK, a file or the name of a shipped example, provides the module; without it the default module is used.

    Exit status: 0 done; 2 bad input, or no air is that fast.
    """
    air = ts.airflow(task, speed=speed, at=at)
    inputs = {"speed_m_s": speed, "thrust_to_weight": air.thrust_to_weight, "thrust_N": air.thrust_N}
    value = {**inputs, **air.smallest.model_dump(mode="json"), **air.present.model_dump(mode="json")}
    options.echo_answer(value, [str(air)])


@command(epilog="Example: topo-search kit push wall-push --out kit", resumes=True)
@click.argument("tasks", metavar="TASK|RUN...", nargs=-1, required=True)
@options.modules
@options.set_field
@options.real_number(
    "--within",
    (0, LIMITS.percent),
    "Largest extra effort over a task's best design.",
    default=2.0,
    metavar="PERCENT",
)
@options.real_number(
    "--bracket-tolerance",
    (0, 10),
    "Range of hinge angles that one bracket may serve, if designs with the angle in its middle are clear.",
    "tolerance_deg",
    default=0.0,
    metavar="DEG",
)
@options.workers
@click.option("--out", type=options.PATH, required=True, metavar="DIR", help="A new or empty folder.")
@options.as_json
def kit(
    tasks: tuple[str, ...], modules: str | None, settings: tuple[str, ...], out: Path, **option_values: Any
) -> None:
    """Choose one design per task so that a few brackets build them all.

    TASK is a file or the name of a shipped example, which `run TASK --keep-within` searches first; RUN is the
    folder of a finished run. Warnings about tasks (see `check`) go to stderr. Candidates are clear designs with as
    many modules as the best one, within --within of its effort. The choice needs the fewest brackets; among such
    choices the fewest joints change from task to task, in the order given; then effort decides. Brackets are of one
    kind if their hinge angles agree, up to the sign, to a thousandth of a degree; the kit has as many of each kind
    as any one task needs. DIR gets `kit.json`, the page `index.html`, the `brackets` to print, a sheet per change
    and a kit per task.

    Exit status: 0 done; 1 not written, since brackets are not clear; 2 bad input; 3 no common kit, because a run
    has no clear design.
    """
    folders = [task for task in tasks if Path(task).is_dir()]
    if folders and (modules or settings):
        raise click.UsageError(f"--modules and --set are for tasks, but {folders[0]} is the folder of a run")
    from topo_search.compose import NotClear
    from topo_search.compose.drawer import NoCommonKit
    from topo_search.compose.drawer import kit as make_kit
    from topo_search.report.shown import visible_progress

    try:
        with visible_progress(tell=note) as observer, catch_warnings(action="ignore", category=ts.SuspiciousTask):
            read = {task: options.task_of(task, settings, modules=modules) for task in tasks if task not in folders}
            for task in read.values():
                options.warn(task)
            shared = make_kit(
                [read.get(task, task) for task in tasks],
                out=out,
                observer=observer,
                note=note,
                **option_values,
            )
    except (NoCommonKit, NotClear) as error:
        note(str(error))
        raise SystemExit(3 if isinstance(error, NoCommonKit) else 1) from None
    options.echo_answer(shared.model_dump(mode="json"), (*shared.lines, f"the kits are in {out}"))
