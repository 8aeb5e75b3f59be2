"""`topo-search export`: a design for other eyes and tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from topo_search.cli import options
from topo_search.cli.errors import explained, needs_extras, note

if TYPE_CHECKING:
    import pandas as pd

    from topo_search.model import Audit, Design

SUFFIXES = {
    ".csv": "csv",
    ".glb": "glb",
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
"""The kind of file that a name's end stands for."""
FOLDERS = ("kit", "brackets")
"""Kinds that are folders."""
PICTURES = ("png", "svg")
SOLIDS = ("glb", "stl")
TABLES = ("assembly", "csv", "parquet")
KIT = ("kit", "allocation", "rotors", "px4", "brackets", "sheet", "parts")
"""The lab kit, and its parts that are files of their own."""
AUDIT = "topo-search/audit"
"""`format` of an audit's file."""


@click.command(epilog="Example: topo-search export runs/push-*/best.json --out push.png")
@click.argument("source", metavar="DESIGN.json|AUDIT.json|RUN")
@click.option(
    "--format",
    "kind",
    type=click.Choice(sorted({*SUFFIXES.values(), *TABLES, *KIT})),
    help="Kind of file (default: by the end of --out's name).",
)
@click.option(
    "--parts",
    type=click.Choice(["all", "platform", "airflow"]),
    help="Solids of a glb or stl; all adds the regions at the target (default: all, of an stl the platform).",
)
@click.option(
    "--angle-step",
    type=click.FloatRange(0, 45, min_open=True),
    callback=options.number,
    metavar="DEG",
    help="Round the hinge angles of a kit, find the inputs again, audit again, and say what changed.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE|DIR",
    help="Where to write it; a file that is there is replaced, and so is the kit in a folder.",
)
def export(source: str, kind: Any, parts: Any, angle_step: float | None, out: Path) -> None:
    """Export a design, an audit or a run to other tools.

    \b
    png, svg      a picture: the platform with its airflow, a close-up, the tree
    glb           a scene for viewers and Blender: platform, airflow, regions at the target
    stl           solids in millimetres for CAD and printing
    mjcf          a model for the simulator MuJoCo, with a keyframe for each load case (.mjcf, .xml)
    urdf          a robot description with a frame at every rotor
    csv, parquet  a table: candidates of a run, clearances of an audit; a design is audited first
    assembly      the assembly sheet as CSV: what to bolt to what, at which angle, in which order
    kit           a folder for the lab: the design, how its rotors act on it, PX4's parameters, hinge
                  brackets and the rod's mount to print, parts list, assembly sheet, a model for MuJoCo
    allocation    the 6 x 4n matrix from rotor inputs to force and torque, with mass and inertia (.json, .csv)
    rotors        the rotors as CSV: position, axis, spin, coefficients
    px4           parameters of PX4's control allocation, for at most 12 rotors (.params)
    brackets      a folder of STL files, in millimetres: a bracket for every joint, the rod's mount
    sheet         the assembly sheet as a page that prints, with drawings (.html)
    parts         the parts list as CSV

    Pictures and parquet need the extra `viz`. A design need not be audited, nor pass its audit.

    Exit status: 0 written; 2 bad input.
    """  # noqa: D301 (\b is click's)
    with explained():
        from topo_search.model import BadInput, Design, Fault
        from topo_search.model.files import read_json

        asked: Any = kind or SUFFIXES.get(out.suffix.lower())
        if kind not in FOLDERS and out.is_dir():
            rule = f"must be a file unless --format is kit or brackets, but {out} is a directory"
            raise BadInput("--out", [Fault("", rule)])
        if asked is None:
            rule = f"must end in {', '.join(SUFFIXES)}, or --format be given, but got {out.name}"
            raise BadInput("--out", [Fault("", rule)])
        if parts is not None and asked not in SOLIDS:
            raise BadInput(
                "--parts", [Fault("", f"must be left out unless the file is a glb or stl, but got {parts}")]
            )
        if angle_step is not None and asked not in KIT:
            raise BadInput("--angle-step", [Fault("", f"belongs to a kit and its parts, but got --format {asked}")])
        if asked in KIT:
            _write_kit(read_json(Design, source), asked, out, angle_step)
            return
        options.require_writable(out)
        with needs_extras(f"--format {asked}"):
            if asked in TABLES:
                _write_table(source, asked, out)
            else:
                _write(read_json(Design, source), asked, parts, out)
        what = (
            "sheet"
            if asked == "sheet"
            else "table"
            if asked in (*TABLES, *KIT)
            else "picture"
            if asked in PICTURES
            else "design"
        )
        click.echo(f"the {what} is in {out}")


def _write(design: Design, kind: Any, parts: Any, out: Path) -> None:
    """Write a design as a kind of file; ModuleNotFoundError names a library that is missing."""
    from topo_search.model.files import write_atomically

    match kind:
        case "mjcf":
            from topo_search.export.mjcf import mjcf

            write_atomically(out, mjcf(design))
        case "urdf":
            from topo_search.export.urdf import urdf

            write_atomically(out, urdf(design))
        case "glb":
            from topo_search.export.solids import glb

            write_atomically(out, glb(design, parts or "all"))
        case "stl":
            from topo_search.export.solids import stl

            write_atomically(out, stl(design, parts or "platform"))
        case _:
            from topo_search.export.picture import draw

            draw(design, out, format=kind)


def _write_kit(design: Design, kind: Any, out: Path, angle_step: float | None) -> None:
    """Write the kit of a design, or a part of it."""
    from topo_search.compose import rounded
    from topo_search.export.kit import folder

    if kind == "kit":
        folder.require_kit_folder(out)
    elif kind != "brackets":
        options.require_writable(out)
    notes: tuple[str, ...] = ()
    if angle_step is not None:
        found = rounded(design, angle_step)
        design, notes = found.design, found.notes
    for text in notes:
        click.echo(text)
    if kind == "kit":
        kit = folder.write_kit(design, out, notes)
        click.echo(f"the kit is in {out}: {', '.join(kit.files)}")
        for text in kit.notes:
            note(text)
    elif kind == "brackets":
        click.echo(f"the brackets are in {out}: {', '.join(folder.write_brackets(design, out))}")
    else:
        folder.write_part(design, kind, out)
        click.echo(f"the {'sheet' if kind == 'sheet' else 'table'} is in {out}")


def _write_table(source: str, kind: Any, out: Path) -> None:
    """Write the table of a run's folder, an audit or a design."""
    from topo_search.export import tables
    from topo_search.model.files import write_atomically

    if kind == "assembly":
        write_atomically(out, _audit_of(source).assembly.csv())
        return
    frame = _table(source)
    write_atomically(out, tables.parquet(frame) if kind == "parquet" else tables.csv(frame))


def _table(source: str) -> pd.DataFrame:
    """Return the candidates of a run's folder, or the clearances of an audit or a design."""
    from topo_search.export.tables import clearances
    from topo_search.study.frame import candidates

    return candidates(Path(source)) if Path(source).is_dir() else clearances(_audit_of(source))


def _audit_of(source: str) -> Audit:
    """Return the audit that a file holds, or that of the design that it holds."""
    from topo_search.compose import audits
    from topo_search.engine import Failed
    from topo_search.model import Audit, BadInput, Design, Fault
    from topo_search.model.files import format_of, read_json

    if format_of(source) == AUDIT:
        return read_json(Audit, source)
    (result,) = audits([read_json(Design, source)])
    if isinstance(result, Failed):
        raise BadInput(source, [Fault("", f"the audit failed: {result.reason}")])
    return result
