"""What a user hands in by files: a list of topologies, designs to start from."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from topo_search.limits import KEYS_BYTES

if TYPE_CHECKING:
    from topo_search.model import Design, Task

near = click.option(
    "--near",
    multiple=True,
    metavar="DESIGN.json",
    help="Add starts from this design of any tree, written by a run or `solve` (repeatable).",
)
topologies = click.option(
    "--topologies",
    metavar="FILE",
    help="Solve only the trees in this file, one key per line as `topologies` prints them; each as given.",
)


def read_near(files: tuple[str, ...]) -> list[Design]:
    """Return the designs of some files; BadInput names every fault."""
    from topo_search.model import Design
    from topo_search.model.files import read_json

    return [read_json(Design, file) for file in files]


def read_topologies(file: str, task: Task) -> tuple[str, ...]:
    """Return the keys of a file that lists the candidates of a task.

    Raises:
        BadInput: it cannot be read or is too long; or names every line that is no key, or not one of the task.
    """
    from topo_search.model.files import load_text
    from topo_search.topologies import own_candidates

    lines = enumerate(load_text(file, most_bytes=KEYS_BYTES).splitlines(), start=1)
    keys = [(number, key) for number, line in lines if (key := line.strip())]
    places = {k: f"line {number}" for k, (number, _) in enumerate(keys)}
    return own_candidates([key for _, key in keys], task, source=file, places=places)
