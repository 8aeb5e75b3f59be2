"""`topo-search capability`: what any vehicle with fixed rotors can do."""

from __future__ import annotations

from pathlib import Path

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors


@click.command(epilog="Example: topo-search capability kit/rotors.csv")
@click.argument("vehicle", metavar="VEHICLE.toml|rotors.csv")
@click.option("--task", "judge", metavar="TASK", help="Judge the vehicle against the load cases of this task.")
@options.out("--out", "page", "Write the figures as a page (.html) as well.")
@options.as_json
def capability(vehicle: str, judge: str | None, page: Path | None, as_json: bool) -> None:
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
    with explain_errors():
        from topo_search.export.audits import flight_lines
        from topo_search.model import BadInput
        from topo_search.model.files import read_task, write_atomically
        from topo_search.model.proven import lower_text
        from topo_search.model.vehicle import read_vehicle
        from verify.flight import capability as capability_of

        options.require_writable(page)
        stated = read_vehicle(vehicle)
        found = capability_of(stated, None if judge is None else read_task(judge))
        if found is None:
            raise BadInput(vehicle, "has wrenches too large, in its weight and size, to compute with")
        if page is not None:
            from topo_search.report.vehicle_page import vehicle_page

            write_atomically(page, vehicle_page(Path(vehicle).name, len(stated.rotors), found))
        if as_json:
            options.echo_json(found.model_dump(mode="json"))
        else:
            click.echo(f"{vehicle}: {len(stated.rotors)} rotors, rank {found.rank} of 6")
            ball = f"{lower_text(found.zero_torque_ball_N, 5)} N in every direction"
            volume = lower_text(found.zero_torque_volume_N3, 5)
            click.echo(f"  forces without torque: {ball}, a volume of {volume} N^3")
            for line in flight_lines(found.flight):
                click.echo(f"  {line.replace(' of module 0', '')}")
            for case in found.flight.cases[1:]:
                verdict = {True: "possible", False: "impossible", None: "undecided"}[case.possible]
                click.echo(f"  {case.name}: {verdict}")
        if found.met is False:
            raise SystemExit(1)
