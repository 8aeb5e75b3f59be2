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
PICTURES = ("png", "svg")
SOLIDS = ("glb", "stl")
TABLES = ("assembly", "csv", "parquet")
KIT = ("kit", "allocation", "rotors", "px4")
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
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE|DIR",
    help="Where to write it; a file that is there is replaced, and so is the kit in a folder.",
)
def export(source: str, kind: Any, parts: Any, out: Path) -> None:
    """Export a design, an audit or a run to other tools.

    \b
    png, svg      a picture: the platform with its airflow, a close-up, the tree
    glb           a scene for viewers and Blender: platform, airflow, regions at the target
    stl           solids in millimetres for CAD and printing
    mjcf          a model for the simulator MuJoCo, with a keyframe for each load case (.mjcf, .xml)
    urdf          a robot description with a frame at every rotor
    csv, parquet  a table: candidates of a run, clearances of an audit; a design is audited first
    assembly      the assembly sheet as CSV: what to bolt to what, at which angle, in which order
    kit           a folder for the lab: the design, how its rotors act on it, PX4's parameters, a model for MuJoCo
    allocation    the 6 x 4n matrix from rotor inputs to force and torque, with mass and inertia (.json, .csv)
    rotors        the rotors as CSV: position, axis, spin, coefficients
    px4           parameters of PX4's control allocation, for at most 12 rotors (.params)

    Pictures and parquet need the extra `viz`. A design need not be audited, nor pass its audit.

    Exit status: 0 written; 2 bad input.
    """  # noqa: D301 (\b is click's)
    with explained():
        from topo_search.model import BadInput, Design, Fault
        from topo_search.model.files import read_json

        asked: Any = kind or SUFFIXES.get(out.suffix.lower())
        if kind != "kit" and out.is_dir():
            raise BadInput("--out", [Fault("", f"must be a file unless --format is kit, but {out} is a directory")])
        if asked is None:
            rule = f"must end in {', '.join(SUFFIXES)}, or --format be given, but got {out.name}"
            raise BadInput("--out", [Fault("", rule)])
        if parts is not None and asked not in SOLIDS:
            raise BadInput(
                "--parts", [Fault("", f"must be left out unless the file is a glb or stl, but got {parts}")]
            )
        if asked == "kit":
            _write_kit(read_json(Design, source), out)
            return
        options.require_writable(out)
        with needs_extras(f"--format {asked}"):
            if asked in TABLES:
                _write_table(source, asked, out)
            else:
                _write(read_json(Design, source), asked, parts, out)
        what = "table" if asked in (*TABLES, *KIT) else "picture" if asked in PICTURES else "design"
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
        case "px4":
            from topo_search.export.allocation import allocation
            from topo_search.export.kit.px4 import px4_parameters

            write_atomically(out, px4_parameters(allocation(design)))
        case "allocation" | "rotors":
            from topo_search.export.allocation import allocation
            from topo_search.model.files import to_json

            acts = allocation(design)
            as_table = acts.rotor_csv if kind == "rotors" else acts.csv
            write_atomically(out, to_json(acts) if out.suffix.lower() == ".json" else as_table())
        case _:
            from topo_search.export.picture import draw

            draw(design, out, format=kind)


def _write_kit(design: Design, folder: Path) -> None:
    """Write the kit of a design and name its files."""
    from topo_search.export.kit.folder import write_kit

    kit = write_kit(design, folder)
    click.echo(f"the kit is in {folder}: {', '.join(kit.files)}")
    for text in kit.notes:
        note(text)


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
