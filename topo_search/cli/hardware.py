"""`topo-search airflow`, `capability` and `kit`: a module's air, any vehicle's flight, one drawer of brackets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from topo_search.cli import options
from topo_search.cli.errors import command, note
from topo_search.limits import LIMITS

if TYPE_CHECKING:
    from topo_search.model.audit import EnvelopeAir


@command(epilog="Example: topo-search capability kit/rotors.csv")
@click.argument("vehicle", metavar="VEHICLE.toml|rotors.csv")
@click.option("--task", "judge", metavar="TASK", help="Judge the vehicle against the load cases of this task.")
@options.out("--out", "page", "Write the figures as a page (.html) as well.")
@options.as_json
def capability(vehicle: str, judge: str | None, page: Path | None) -> None:
    """State what any vehicle with fixed rotors can do, as the audit does of a design.

    \b
    rotors.csv    a row per rotor: x_m, y_m, z_m from the centre of mass, ax, ay, az (its thrust axis),
                  spin (1 counter-clockwise seen against its thrust, else -1), k_f, k_tau, u_max and,
                  if it is not 0, u_min (below 0: reversible); or the rotors.csv of a kit
    VEHICLE.toml  mass, inertia, com, end_effector, gravity and rotors = "rotors.csv"

    A table alone stands for a mass of 1 kg. Loads of a task act where the vehicle has its end-effector; weights are
    those of the vehicle.

    Exit status: 0; 1 a load case of the task is not proven to be possible; 2 bad input.
    """  # noqa: D301 (\b is click's)
    from topo_search.export.audits import flight_lines
    from topo_search.model import BadInput
    from topo_search.model.files import read_task, write_atomically
    from topo_search.model.flight import read_vehicle
    from topo_search.model.proven import lower_text
    from verify.flight.vehicle import capability as capability_of

    options.require_writable(page)
    loaded = read_vehicle(vehicle)
    result = capability_of(loaded, None if judge is None else read_task(judge))
    if result is None:
        raise BadInput(vehicle, "has wrenches too large, in its weight and size, to compute with")
    if page is not None:
        from topo_search.report.design_page import vehicle_page

        write_atomically(page, vehicle_page(Path(vehicle).name, len(loaded.rotors), result))
    ball = f"{lower_text(result.zero_torque_ball_N, 5)} N in every direction"
    volume = lower_text(result.zero_torque_volume_N3, 5)
    verdicts = {True: "possible", False: "impossible", None: "undecided"}
    lines = [
        f"{vehicle}: {len(loaded.rotors)} rotors, rank {result.rank} of 6",
        f"  forces without torque: {ball}, a volume of {volume} N^3",
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
    help="Thrust of the module: its weight, the most that it has, or a multiple of its weight.",
)
@options.as_json
def airflow(task: str | None, speed: float, at: str) -> None:
    """Compute the smallest cone-sphere around all air of one module that is at least as fast as V.

    Prints start_radius, spread_angle_deg and reach for [module.airflow], and the largest speeds on the envelope
    that the module has now. That no air outside is as fast is proven of the jet model: averages over time, one
    module alone in free air. No cone-sphere around that air is smaller by more than 1 %.

    TASK is a file, or the name of a shipped example, whose module is meant; without it, the default module.

    Exit status: 0; 2 bad input, or no air is as fast.
    """
    from topo_search.compose.binding import enclose_speed, envelope_of_speed
    from topo_search.model import Module
    from topo_search.model.files import read_task
    from topo_search.model.module import AIR_DENSITY
    from topo_search.model.proven import lower_text, upper_text
    from topo_search.model.task import Task
    from verify.air.envelope import envelope_air

    module, density, gravity = Module(), AIR_DENSITY, Task.model_fields["gravity"].default
    if task is not None:
        read = enclose_speed(read_task(task))
        module, density, gravity = read.module, read.air_density, read.gravity
    ratio = _thrust_to_weight(at, module.max_thrust_to_weight)
    thrust = ratio * module.mass * gravity
    where = f"{ratio:.4g} times the weight of a module, {thrust:.4g} N"
    least = envelope_of_speed(module, density, gravity, speed, ratio, source="--speed")
    present = envelope_air(module, density, thrust)
    inputs = {"speed_m_s": speed, "thrust_to_weight": ratio, "thrust_N": thrust}
    volume, bound = upper_text(least.volume_m3, 4), lower_text(least.least_volume_m3, 4)
    lines = [
        f"at {where}, all air of {speed:g} m/s and more is inside",
        f"  start_radius = {upper_text(least.start_radius_m, 5)}",
        f"  spread_angle_deg = {upper_text(least.spread_angle_deg, 5)}",
        f"  reach = {upper_text(least.reach_m, 5)}",
        f"a volume of {volume} m³; none is below {bound} m³",
        "largest speeds on the present envelope",
        *(f"  {name:14} {words}" for name, words in speeds_on(present)),
    ]
    options.echo_answer({**inputs, **least.model_dump(mode="json"), **present.model_dump(mode="json")}, lines)


def speeds_on(envelope: EnvelopeAir) -> Iterator[tuple[str, str]]:
    """Yield the largest speeds on a module's own envelope, each with where it is."""
    from topo_search.model.proven import upper_text

    yield "side", f"{upper_text(envelope.side_m_s, 3)} m/s"
    if envelope.side_merged_m_s is not None:
        yield "side, merged", f"{upper_text(envelope.side_merged_m_s, 3)} m/s"
    yield "far end", f"{upper_text(envelope.end_m_s, 3)} m/s"
    yield "rotor plane", f"{upper_text(envelope.rotor_plane_m_s, 3)} m/s, outside it"


def _thrust_to_weight(at: str, most: float) -> float:
    """Return the thrust over the weight that `--at` names."""
    try:
        ratio = {"hover": 1.0, "full": most}.get(at) or float(at)
    except ValueError:
        ratio = math.nan
    if not 0 < ratio <= most:
        rule = f'must be "hover", "full" or a thrust over the weight, above 0 and at most {most:g}'
        raise click.BadParameter(f"{rule}, but got {at}", param_hint="'--at'")
    return ratio


@command(epilog="Example: topo-search kit push wall-push --out kit", resumes=True)
@click.argument("tasks", metavar="TASK|RUN...", nargs=-1, required=True)
@options.modules
@options.set_field
@options.real_number(
    "--within",
    (0, LIMITS.percent),
    "Largest extra effort over the best design of a task.",
    default=2.0,
    metavar="PERCENT",
)
@options.real_number(
    "--bracket-tolerance",
    (0, 10),
    "Range of hinge angles that one bracket may serve, where designs with its middle are clear.",
    "tolerance_deg",
    default=0.0,
    metavar="DEG",
)
@options.workers
@click.option("--out", type=options.PATH, required=True, metavar="DIR", help="A new or empty folder.")
@options.as_json
def kit(
    tasks: tuple[str, ...],
    modules: str | None,
    settings: tuple[str, ...],
    out: Path,
    **option_values: Any,
) -> None:
    """Choose one design per task so that a few brackets build them all.

    TASK is a file or the name of a shipped example, which `run TASK --keep-within` searches first; RUN is the
    folder of a finished run. Candidates are clear designs with as many modules as the best one, within --within of
    its effort. The drawer has the fewest brackets; among those choices the fewest joints change from task to task,
    in the order given; then effort decides. A kind of bracket is the size of a hinge angle, to a thousandth of a
    degree; the drawer holds as many as the task that needs most of them. DIR gets `kit.json`, the page
    `index.html`, the drawer's `brackets` to print, a sheet per change and a kit per task, as from
    `export --format kit`.

    Exit status: 0; 2 bad input; 3 no common kit, because a run has no clear design.
    """
    folders = [task for task in tasks if Path(task).is_dir()]
    if folders and (modules or settings):
        raise click.UsageError(f"--modules and --set are for tasks, but {folders[0]} is the folder of a run")
    from topo_search.cli.progress import shown_progress
    from topo_search.compose.drawer import NoCommonKit
    from topo_search.compose.drawer import kit as make_kit

    try:
        with shown_progress() as observer:
            shared = make_kit(
                [task if task in folders else options.task_of(task, settings, modules=modules) for task in tasks],
                out=out,
                observer=observer,
                note=note,
                **option_values,
            )
    except NoCommonKit as error:
        note(str(error))
        raise SystemExit(3) from None
    options.echo_answer(shared.model_dump(mode="json"), (*shared.lines, f"the kits are in {out}"))
