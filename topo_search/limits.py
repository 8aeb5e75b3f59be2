"""Upper limits of inputs, which the documentation lists under "Limits of input", and counts in words.

What is within these limits is worked on to its end, in time and memory that are known. What is beyond them is
refused by name before any work is done for it.

`--help` loads this file, so it loads nothing itself.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """The largest of each input, unless it says otherwise; sizes of files in bytes."""

    task_bytes: int = 2**20
    """Size of a task file; one at all the other limits at once is shorter."""
    design_bytes: int = 8 * 2**20
    """Size of a design file; one of 200 modules and 200 load cases has about half as many bytes."""
    result_bytes: int = 64 * 2**20
    """Size of any other file that the program wrote: audits and the tables of experiments."""
    run_bytes: int = 1024 * 2**20
    """Size of a file in a run folder that is compared with what the run wrote."""
    mesh_bytes: int = 16 * 2**20
    """Size of an STL or OBJ file."""

    modules: int = 200
    """Modules of a platform."""
    sizes: int = 20
    """Numbers of modules that one task asks for."""
    listed_modules: int = 1_000
    """Modules of trees that are only counted, drawn or listed."""
    drawn_trees: int = 1_000_000
    """Trees drawn at once."""
    load_cases: int = 200
    """Load cases of a task."""
    failures: int = 20_000
    """Wrenches that must be possible with some rotor dead, over all rotors, load cases and corners."""
    requirements: int = 20
    """Exposure requirements of a task."""
    segments: int = 200
    """Straight pieces of motion paths, planes and convex pieces of all requirements of a task together."""
    corners: int = 100
    """Corners of a convex region, or of one of its pieces: the solver looks at each of them for every module."""
    all_corners: int = 2_000
    """Corners of all convex regions of a task together."""
    pieces: int = 100
    """Convex pieces of a region."""
    levels: int = 1_000
    """Combinations of the levels of all goals: each takes as long as a run of its own."""
    hinge_angles: int = 1_000
    """Angles of a set that hinges are held to; a step may make more."""

    facets: int = 100_000
    """Triangles of a mesh file, polygons cut into triangles; of its vertices there may be three times as many."""
    frame_pieces: int = 100
    """Convex pieces of a module's own frame."""
    frame_triangles: int = 5_000
    """Triangles of all pieces of a module's own frame."""

    key_parts: int = 30
    """Parts of a dotted key in TOML, and of a field in a setting."""
    lists: int = 50_000
    """Opening brackets of a TOML text; a task at all the other limits at once has a third as many."""
    workers: int = 256
    """Processes of one command; each takes as much memory as a solve."""
    starts: int = 10_000
    """Starts of a topology."""
    trials: int = 100_000
    """Candidates that a sampler proposes."""
    round: int = 1_000
    """Proposals whose results may be unknown when another is made."""
    candidates: int = 2_000_000
    """Candidates of one size in an exhaustive search: their table stays within `run_bytes`."""
    own_topologies: int = 10_000
    """Trees that a user lists as the candidates of a run."""
    keys_bytes: int = 4 * 2**20
    """Size of a file of keys; one of as many topologies of 200 modules has about half as many bytes."""
    near: int = 100
    """Designs to start from: each is one more start of every candidate."""
    own_constraints: int = 100
    """User constraints in one run."""
    trees: int = 10_000
    """Trees of one size in an experiment."""
    cells: int = 20_000
    """Cells of an experiment: its table stays within `result_bytes`."""
    seconds: int = 1_000_000_000
    """Time limit: 31 years."""
    gaps: tuple[float, float] = (1e-4, 0.5)
    """Least and greatest gap that a proof can be asked for."""
    percent: int = 1000
    """Effort over the best, of designs that are kept or that a kit chooses from [%]."""

    largest_integer: int = 2**63 - 1
    """Seeds and other whole numbers without a range of their own: what TOML promises to every reader."""


LIMITS = Limits()


def quantity(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
