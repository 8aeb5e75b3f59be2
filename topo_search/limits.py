"""Limits of inputs, listed in the documentation under "Limits of input", and numbers in words.

Inputs within these limits are processed in bounded time and memory. Larger inputs are refused by name before any
work is done.

`--help` loads this file, so it imports nothing.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Upper limits of inputs; sizes of files in bytes."""

    task_bytes: int = 2**20
    """Size of a task file; a task at all other limits is smaller."""
    design_bytes: int = 8 * 2**20
    """Size of a design file; one with 200 modules and 200 load cases has about half as many bytes."""
    result_bytes: int = 64 * 2**20
    """Size of any other file written by the program: audits and tables of experiments."""
    run_bytes: int = 1024 * 2**20
    """Size of a file in a run folder that is compared with the run's output."""
    mesh_bytes: int = 16 * 2**20
    """Size of an STL or OBJ file."""

    modules: int = 200
    """Modules of a platform."""
    lattice_modules: int = 10
    """Modules of a flat lattice; of ten there are 36,446."""
    sizes: int = 20
    """Numbers of modules in one task."""
    listed_modules: int = 1_000
    """Modules of trees that are only counted, sampled or listed."""
    drawn_trees: int = 1_000_000
    """Trees sampled at once."""
    load_cases: int = 200
    """Load cases of a task."""
    failures: int = 20_000
    """Required wrenches with a dead rotor, over all rotors, load cases and corners."""
    requirements: int = 20
    """Exposure requirements of a task."""
    segments: int = 200
    """Straight pieces of motion paths, planes and convex pieces, in all requirements of a task together."""
    corners: int = 100
    """Corners of a convex region, or of one of its pieces; the solver checks each of them for every module."""
    all_corners: int = 2_000
    """Corners of all convex regions of a task together."""
    pieces: int = 100
    """Convex pieces of a region."""
    levels: int = 1_000
    """Combinations of the levels of all goals; each takes as long as a run."""
    hinge_angles: int = 1_000
    """Angles in a set of hinge angles; a step may give more."""

    facets: int = 100_000
    """Triangles of a mesh file, after triangulation of polygons; three times as many vertices are allowed."""
    frame_pieces: int = 100
    """Convex pieces of a module's custom frame."""
    rotors: int = 24
    """Rotors of a module."""
    frame_triangles: int = 5_000
    """Triangles of all pieces of a module's custom frame."""

    workers: int = 256
    """Processes of one command; each needs the memory of a solve."""
    starts: int = 10_000
    """Starts of a topology."""
    trials: int = 100_000
    """Candidates proposed by a sampler."""
    round: int = 1_000
    """Proposals that may be pending when another is made."""
    candidates: int = 2_000_000
    """Candidates of one size in an exhaustive search; their table stays within `run_bytes`."""
    own_topologies: int = 10_000
    """Trees in a user's list of candidates."""
    keys_bytes: int = 4 * 2**20
    """Size of a file of keys; `own_topologies` keys of 200 modules have about half as many bytes."""
    near: int = 100
    """Designs to start from; each is an additional start of every candidate."""
    own_constraints: int = 100
    """User constraints in one run."""
    trees: int = 10_000
    """Trees of one size in an experiment."""
    seconds: int = 1_000_000_000
    """Time limit [s]: 31 years."""
    gaps: tuple[float, float] = (1e-4, 0.5)
    """Smallest and largest gap that a proof can aim for."""
    angle_steps: tuple[float, float] = (0.1, 45.0)
    """Step of rounded hinge angles [deg]: from the precision of brackets."""
    percent: int = 1000
    """Effort above the best one, of designs that are kept or that a kit chooses from [%]."""

    largest_integer: int = 2**63 - 1
    """Seeds and other integers without their own range; the range that every TOML reader supports."""


LIMITS = Limits()


def quantity(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless it is 1."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def figures(value: float, digits: int = 4) -> str:
    """Return a number with `digits` significant digits; large and small ones with a power of ten."""
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text.replace("-", "−")
    mantissa, exponent = text.split("e")
    superscripts = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return f"{mantissa} × 10{str(int(exponent)).translate(superscripts)}".replace("-", "−")


def length(metres: float) -> str:
    """Return a length in mm, cm or m, whichever suits its size."""
    if abs(metres) < 0.01:
        return f"{figures(1000 * metres, 3)} mm"
    return f"{figures(100 * metres, 3)} cm" if abs(metres) < 1 else f"{figures(metres, 3)} m"


def vector(values: tuple[float, ...]) -> str:
    """Return a vector with three significant digits per entry; entries below 1e-9 of the largest are 0."""
    smallest = 1e-9 * max(map(abs, values))
    return f"[{', '.join(figures(x if abs(x) > smallest else 0.0, 3) for x in values)}]"
