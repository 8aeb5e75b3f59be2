"""`topo-search export`: pictures, models and tables of a design for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command, needs_extras, note

if TYPE_CHECKING:
    from topo_search.export.mjcf import Physics

SUFFIXES = {
    ".csv": "csv",
    ".glb": "glb",
    ".npz": "air",
    ".vti": "air",
    ".html": "sheet",
    ".mjcf": "mjcf",
    ".xml": "mjcf",
    ".parquet": "parquet",
    ".params": "px4",
    ".png": "png",
    ".stl": "stl",
    ".svg": "svg",
    ".urdf": "urdf",
}
"""File format by suffix; installed packages add more."""
PICTURES = ("png", "svg")
TABLES = ("assembly", "csv", "parquet")
KIT = ("kit", "allocation", "rotors", "px4", "brackets", "sheet", "parts")
"""The lab kit, and its parts that can be written on their own."""
BUILT_IN = tuple(sorted({*SUFFIXES.values(), *TABLES, *KIT}))
"""All formats of this package."""


@command(epilog="Example: topo-search export runs/push-*/best.json --out push.png")
@click.argument("source", metavar="DESIGN.json|AUDIT.json|RUN")
@click.option(
    "--format",
    "kind",
    metavar=f"[{'|'.join(BUILT_IN)}|...]",
    help="File format (default: by the suffix of --out).",
)
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
    (0, 45),
    "Round the hinge angles of a kit to this step, recompute the inputs, audit again and report the changes.",
    metavar="DEG",
    above=True,
)
@options.real_number(
    "--motor-lag",
    (0, 10),
    "Time constant of rotor thrust in the MuJoCo model (default: none).",
    metavar="SECONDS",
    above=True,
)
@click.option("--rod-mass", is_flag=True, help="Give the rod its mass in the MuJoCo model in any case.")
@click.option(
    "--contacts",
    is_flag=True,
    help="Add contacts to the MuJoCo model: a tip for the rod, and the task's solid regions.",
)
@click.option(
    "--out",
    type=options.PATH,
    required=True,
    metavar="FILE|DIR",
    help="Output file or folder; an existing file or kit is overwritten.",
)
def export(
    source: str,
    kind: Any,
    parts: Any,
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
    png, svg      a picture: the platform with its airflow, a close-up, the tree
    glb           a scene for viewers and Blender: platform, airflow, regions at the target
    stl           solids in millimetres for CAD and printing
    mjcf          a model for the simulator MuJoCo, with a keyframe for each load case (.mjcf, .xml)
    urdf          a robot description with a frame at every rotor
    air           air speeds on a grid, a field for each load case (.npz, or .vti for ParaView)
    csv, parquet  a table: candidates of a run, clearances of an audit; a design is audited first
    assembly      the assembly sheet as CSV: what to bolt to what, at which angle, in which order
    kit           a folder for the lab: design, allocation matrix, allocator in Python, PX4 parameters,
                  hinge brackets and rod mount to print, parts list, assembly sheet, MuJoCo model
    allocation    the 6 x 4n matrix from rotor inputs to force and torque, with mass and inertia (.json, .csv)
    rotors        the rotors as CSV: position, axis, spin, coefficients
    px4           parameters of PX4's control allocation, for at most 12 rotors (.params)
    brackets      a folder of STL files, in millimetres: a bracket for every joint, the rod's mount
    sheet         the printable assembly sheet with drawings (.html)
    parts         the parts list as CSV

    Installed packages may add formats of their own (entry points `topo_search.formats`).

    Pictures and parquet need the extra `viz`. The design is audited. If it is not clear, it is exported with a
    warning, but neither as a kit nor with rounded angles.

    Exit status: 0 written; 1 not written, since a kit or a design with rounded angles is not clear; 2 bad input.
    """  # noqa: D301 (\b is click's)
    from topo_search.compose import audit, read_completed, read_design
    from topo_search.export.formats import content, find_format, formats
    from topo_search.export.mjcf import Physics
    from topo_search.model.files import write_atomically

    if kind not in (None, *BUILT_IN) and kind not in formats():
        rule = f"must be one of {', '.join(sorted({*BUILT_IN, *formats()}))}, but got {kind!r}"
        raise click.BadParameter(rule, click.get_current_context(), param_hint="'--format'")
    suffix = out.suffix.lower()
    target: Any = kind or SUFFIXES.get(suffix)
    target = target or next((own.name for own in formats().values() if suffix in own.suffixes), None)
    if kind not in ("kit", "brackets") and out.is_dir():
        raise ts.BadInput("--out", f"must be a file unless --format is kit or brackets, but {out} is a directory")
    if target is None:
        rule = f"must end in {', '.join(SUFFIXES)}, unless --format is given, but got {out.name}"
        raise ts.BadInput("--out", rule)
    if parts is not None and target not in ("glb", "stl"):
        raise ts.BadInput("--parts", f"applies only to glb and stl, but got {parts}")
    if air_speed is not None and target not in ("glb", *PICTURES):
        raise ts.BadInput("--air-speed", f"applies only to glb, png and svg, but got --format {target}")
    if load_case is not None and air_speed is None:
        raise ts.BadInput("--load-case", "applies only with --air-speed")
    if angle_step is not None and target not in KIT:
        raise ts.BadInput("--angle-step", f"applies only to a kit and its parts, but got --format {target}")
    if target == "air" and SUFFIXES.get(suffix) != "air":
        raise ts.BadInput("--out", f"must end in .npz or .vti, but got {out.name}")
    physics = Physics(motor_lag, rod_mass, contacts, solid_regions=contacts)
    if physics != Physics() and target not in ("mjcf", "kit"):
        rule = f"apply only to a MuJoCo model (mjcf, kit), but got --format {target}"
        raise ts.BadInput("--motor-lag, --rod-mass, --contacts", rule)
    if target in KIT:
        _write_kit(read_completed(source), target, out, angle_step, physics)
        return
    options.require_writable(out)
    with needs_extras(f"--format {target}"):
        if target in TABLES:
            write_atomically(out, _table(source, target))
        else:
            shows_gap = target in PICTURES or target not in BUILT_IN
            design = (read_design if shows_gap else read_completed)(source)
            surface = None
            if air_speed is not None:
                from topo_search.export.air_field import air_surface

                surface = air_surface(design, air_speed, load_case or 0)
            keywords: dict[str, dict[str, Any]] = {
                "glb": {"parts": parts or "all", "air": surface},
                "stl": {"parts": parts or "platform"},
                "mjcf": {"physics": physics},
                **{picture: {"air": surface} for picture in PICTURES},
            }
            if target == "air":
                from topo_search.export.air_field import air_field, npz, vti

                write_atomically(out, (vti if suffix == ".vti" else npz)(air_field(design)))
            else:
                write_atomically(out, content(design, find_format(target), **keywords.get(target, {})))
            _warn_unless_clear(audit(design))
    kinds = dict.fromkeys(TABLES, "table") | dict.fromkeys(PICTURES, "picture")
    click.echo(f"the {kinds.get(target, 'design')} is in {out}")


def _warn_unless_clear(audit: ts.Audit) -> None:
    """Warn if the audit of an exported design is not clear."""
    if audit.verdict != ts.Status.CLEAR:
        broken = [pair.name for pair in audit.pairs if pair.status != ts.Status.CLEAR]
        broken += [residual.name for residual in audit.residuals if residual.status != ts.Status.CLEAR]
        shown = ", ".join(broken[:3]) + ", ..." * (len(broken) > 3)
        note(f"warning: the audit of this design is {audit.verdict}: {shown}")


def _write_kit(design: ts.Design, kind: Any, out: Path, angle_step: float | None, physics: Physics) -> None:
    """Write the kit of a design, or one of its parts."""
    from topo_search.compose import audit, brackets_note, round_angles
    from topo_search.export.allocation import allocation, px4_warnings
    from topo_search.export.audits import broken_lines
    from topo_search.export.brackets import require_room
    from topo_search.export.kit import PIECES, require_kit_folder, write_brackets, write_kit
    from topo_search.model.files import write_atomically

    if kind == "kit":
        require_kit_folder(out)
    elif kind != "brackets":
        options.require_writable(out)
    if kind in ("kit", "sheet"):
        require_room(design.task.module)
    notes: tuple[str, ...] = ()
    if angle_step is None:
        audited = audit(design)
    else:
        design, audited, notes = round_angles(design, angle_step)
    options.echo_lines(notes)
    if audited.verdict != ts.Status.CLEAR and (kind == "kit" or angle_step is not None):
        for text in broken_lines(audited):
            note(text)
        note(f"nothing is written: the audit of this design is {audited.verdict}")
        raise SystemExit(1)
    _warn_unless_clear(audited)
    if kind in ("kit", "sheet"):
        note(brackets := brackets_note(design))
        notes += (brackets,)
    if kind == "kit":
        kit = write_kit(design, out, notes, physics)
        click.echo(f"the kit is in {out}: {', '.join(kit.files)}")
        for text in kit.notes:
            note(text)
    elif kind == "brackets":
        click.echo(f"the brackets are in {out}: {', '.join(write_brackets(design, out))}")
    else:
        effectiveness = allocation(design)
        as_json = kind == "allocation" and out.suffix.lower() == ".json"
        write_atomically(out, ts.to_json(effectiveness) if as_json else PIECES[kind](design, notes))
        for text in px4_warnings(effectiveness) if kind == "px4" else ():
            note(f"warning: {text}")
        click.echo(f"the {'sheet' if kind == 'sheet' else 'table'} is in {out}")


def _table(source: str, kind: Any) -> str | bytes:
    """Return a table: the candidates of a run, or the clearances or the assembly of an audit or a design."""
    from topo_search.export.audits import clearances, csv, parquet
    from topo_search.study.answer import candidates

    if kind == "assembly":
        return _audit_of(source).assembly.csv()
    frame = candidates(Path(source)) if Path(source).is_dir() else clearances(_audit_of(source))
    return parquet(frame) if kind == "parquet" else csv(frame)


def _audit_of(source: str) -> ts.Audit:
    """Return the audit in a file, or audit the design in it."""
    from topo_search.cli.runs import AUDIT_FORMAT
    from topo_search.compose import audits, read_completed
    from topo_search.engine import Failed
    from topo_search.model.files import format_of, load_json

    if format_of(load_json(source)) == AUDIT_FORMAT:
        return ts.read_json(ts.Audit, source)
    (result,) = audits([read_completed(source)])
    if isinstance(result, Failed):
        raise ts.BadInput(source, f"the audit failed: {result.reason}")
    return result
