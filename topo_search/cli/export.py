"""`topo-search export`: pictures, models and tables of a design for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command, needs_extras, note
from topo_search.export.formats import BUILT_IN
from topo_search.limits import LIMITS

if TYPE_CHECKING:
    import pandas as pd

    from topo_search.export.mjcf import Physics
    from topo_search.model import Assembly


@command(epilog="Example: topo-search export runs/push-*/best.json --out push.png")
@click.argument("source", metavar="DESIGN.json|AUDIT.json|RUN")
@click.option("--format", "kind", metavar="NAME", help="File format (default: by the suffix of --out).")
@options.choice(
    "--parts",
    ["all", "platform", "airflow"],
    "Solids of a glb or stl; `all` includes the target regions (default: all; stl: platform).",
)
@options.real_number(
    "--air-speed",
    (0, None),
    "Draw all air faster than this in a glb or a picture; in a picture it replaces the airflow envelopes.",
    metavar="M/S",
    above=True,
)
@options.whole_number("--load-case", (0, None), "Load case for --air-speed (default: 0).", metavar="K")
@options.real_number(
    "--angle-step",
    LIMITS.angle_steps,
    "Round the hinge angles of a kit to this step, solve the rest again, audit it and report the changes.",
    metavar="DEG",
)
@options.real_number(
    "--motor-lag",
    (0, 10),
    "Time constant of rotor thrust in the MuJoCo model (default: none).",
    metavar="SECONDS",
    above=True,
)
@options.flag("--rod-mass", "Give the rod its mass in the MuJoCo model in any case.")
@options.flag("--contacts", "Add contacts to the MuJoCo model: a tip for the rod, and the task's solid regions.")
@click.option(
    "--out",
    type=options.PATH,
    required=True,
    metavar="FILE|DIR",
    help="Output file or folder; an existing file or kit is overwritten.",
)
def export(
    source: str,
    kind: str | None,
    parts: str | None,
    air_speed: float | None,
    load_case: int | None,
    angle_step: float | None,
    motor_lag: float | None,
    rod_mass: bool,
    contacts: bool,
    out: Path,
) -> None:
    """Export a design, an audit or a run to other tools.

    \b
    FORMATS

    Installed packages may add formats of their own (entry points `topo_search.formats`).

    Pictures and parquet need the extra `viz`. The design is audited. If it is not clear, it is exported with a
    warning, but neither as a kit nor with rounded angles.

    Exit status: 0 written; 1 not written, since a kit, its brackets or any rounding is not clear; 2 bad input.
    """  # noqa: D301 (\b is click's)
    from topo_search.compose import NotClear, audit, brackets_note, read_completed, read_design, round_angles
    from topo_search.export.audits import broken_lines
    from topo_search.export.brackets import require_room
    from topo_search.export.formats import choose, formats, write
    from topo_search.export.kit import require_kit_folder
    from topo_search.export.mjcf import Physics

    chosen = choose(kind, out, known := formats())
    context = click.get_current_context()
    for parameter in context.command.params:
        given = context.get_parameter_source(parameter.name or "") is ParameterSource.COMMANDLINE
        if given and (option := parameter.opts[0]) not in ("source", "--format", "--out", *chosen.takes):
            takers = ", ".join(each.name for each in known.values() if option in each.takes)
            raise ts.BadInput(option, f"applies only to {takers}, but got --format {chosen.name}")
    if load_case is not None and air_speed is None:
        raise ts.BadInput("--load-case", "applies only with --air-speed")
    if chosen.reads != "folder":
        options.require_writable(out)
    elif chosen.name == "kit":
        require_kit_folder(out)
    with needs_extras(f"--format {chosen.name}"):
        if chosen.reads == "table":
            write(chosen, _table(source, chosen.name), out)
            click.echo(f"the table is in {out}")
            return
        shows_gap = chosen.noun == "picture" or chosen.own
        design, notes = (read_design if shows_gap else read_completed)(source), tuple[str, ...]()
        if chosen.name in ("kit", "sheet"):
            require_room(design)
        if angle_step is None:
            audited = audit(design)
        else:
            try:
                design, audited, notes = round_angles(design, angle_step)
            except NotClear as error:
                note(f"nothing is written: {error}")
                raise SystemExit(1) from None
        options.echo_lines(notes)
        brackets, are_clear = brackets_note(design) if chosen.name in ("kit", "sheet") else ("", True)
        verdict = "" if audited.verdict == ts.Status.CLEAR else f": the audit of this design is {audited.verdict}"
        if not are_clear:
            note(brackets)
        if chosen.name == "kit" and (verdict or not are_clear):
            for text in (*broken_lines(audited), f"nothing is written{verdict}"):
                note(text)
            raise SystemExit(1)
        if verdict:
            note(f"warning{verdict}: {audited.failure(design.task)}")
        notes += (brackets,) * bool(brackets)
        physics = Physics(motor_lag, rod_mass, contacts, solid_regions=contacts)
        if chosen.reads == "folder":
            _write_folder(design, chosen.name, out, notes, physics)
            return
        keywords: dict[str, Any] = {"parts": parts} if parts else {}
        if air_speed is not None:
            from topo_search.export.air_field import air_surface

            keywords["air"] = air_surface(design, air_speed, load_case or 0)
        if physics != Physics():
            keywords["physics"] = physics
        if "notes" in chosen.takes:
            keywords["notes"] = notes
        write(chosen, design, out, **keywords)
    if chosen.name == "px4":
        from topo_search.export.allocation import allocation, px4_warnings

        for text in px4_warnings(allocation(design)):
            note(f"warning: {text}")
    click.echo(f"the {chosen.noun} is in {out}")


export.help = str(export.help).replace(
    "FORMATS", "\n    ".join(f"{each.name:<12}{each.says} {' '.join(each.suffixes)}".rstrip() for each in BUILT_IN)
)


def _write_folder(design: ts.Design, name: str, out: Path, notes: tuple[str, ...], physics: Physics) -> None:
    """Write a kit, or the brackets alone."""
    from topo_search.export.kit import write_brackets, write_kit

    if name == "brackets":
        click.echo(f"the brackets are in {out}: {', '.join(write_brackets(design, out))}")
        return
    for text in write_kit(design, out, notes, physics).notes:
        note(text)
    click.echo(f"the kit is in {out}")


def _table(source: str, name: str) -> pd.DataFrame | Assembly:
    """Return a table: the candidates of a run, or the clearances or the assembly of an audit or a design."""
    from topo_search.export.audits import clearances
    from topo_search.study.tables import candidates

    if name == "assembly":
        return _audit_of(source).assembly
    return candidates(Path(source)) if Path(source).is_dir() else clearances(_audit_of(source))


def _audit_of(source: str) -> ts.Audit:
    """Return the audit in a file, or audit the design in it."""
    from topo_search.compose import audits, read_completed
    from topo_search.engine import Failed
    from topo_search.model.files import is_audit, load_json

    if is_audit(load_json(source)):
        return ts.read_json(ts.Audit, source)
    (result,) = audits([read_completed(source)])
    if isinstance(result, Failed):
        raise ts.BadInput(source, f"the audit failed: {result.reason}")
    return result
