"""`topo-search export`: a design for other eyes and tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from topo_search.cli import options
from topo_search.cli.errors import explained

if TYPE_CHECKING:
    from topo_search.model import Design

SUFFIXES = {
    ".glb": "glb",
    ".mjcf": "mjcf",
    ".xml": "mjcf",
    ".png": "png",
    ".stl": "stl",
    ".svg": "svg",
    ".urdf": "urdf",
}
"""The kind of file that a name's end stands for."""
SOLIDS = ("glb", "stl")
EXTRAS = {"matplotlib": "viz", "trimesh": "viz"}
"""The extra that brings a library."""


@click.command(epilog="Example: topo-search export runs/push-*/best.json --out push.png")
@click.argument("design", metavar="DESIGN.json")
@click.option(
    "--format",
    "kind",
    type=click.Choice(sorted({*SUFFIXES.values()})),
    help="Kind of file (default: by the end of --out's name).",
)
@click.option(
    "--parts",
    type=click.Choice(["all", "platform", "airflow"]),
    help="Solids of a glb or stl; all adds the regions at the target (default: all, of an stl the platform).",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    metavar="FILE",
    help="Where to write it; a file that is there is replaced.",
)
def export(design: str, kind: Any, parts: Any, out: Path) -> None:
    """Hand a design to other tools.

    \b
    png, svg   a picture: the platform with its airflow, a close-up, the tree
    glb        a scene for viewers and Blender: platform, airflow, regions at the target
    stl        solids in millimetres for CAD and printing
    mjcf       a model for the simulator MuJoCo, with a keyframe for each load case (.mjcf, .xml)
    urdf       a robot description with a frame at every rotor

    Pictures and solids need the extra `viz`.

    The design need not be audited, nor pass its audit.

    Exit status: 0 written; 2 bad input.
    """  # noqa: D301 (\b is click's)
    with explained():
        from topo_search.model import BadInput, Design, Fault
        from topo_search.model.files import read_json

        asked: Any = kind or SUFFIXES.get(out.suffix.lower())
        if asked is None:
            rule = f"must end in {', '.join(SUFFIXES)}, or --format be given, but got {out.name}"
            raise BadInput("--out", [Fault("", rule)])
        if parts is not None and asked not in SOLIDS:
            raise BadInput(
                "--parts", [Fault("", f"must be left out unless the file is a glb or stl, but got {parts}")]
            )
        options.require_writable(out)
        read = read_json(Design, design)
        try:
            _write(read, asked, parts, out)
        except ModuleNotFoundError as error:
            extra = EXTRAS.get(error.name or "")
            if extra is None:
                raise
            how = f'needs {error.name}, which is not installed; type: pip install "topo-search[{extra}]"'
            raise BadInput(f"--format {asked}", [Fault("", how)]) from None
        click.echo(f"{'the picture' if asked in ('png', 'svg') else 'the design'} is in {out}")


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
