"""Upper limits of inputs; `docs/pages/reference/limits.md` has the same as a table.

What is within these limits is worked on to its end, in time and memory that are known. What is beyond them is
refused by name before any work is done for it.
"""

from __future__ import annotations

MIB = 2**20

TASK_BYTES = MIB
"""Size of a task file; one at all the other limits at once is shorter."""
DESIGN_BYTES = 8 * MIB
"""Size of a design file; one of 200 modules and 200 load cases has about half as many bytes."""
RESULT_BYTES = 64 * MIB
"""Size of any other file that the program wrote: audits and the tables of experiments."""
RUN_BYTES = 1024 * MIB
"""Size of a file in a run folder that is compared with what the run wrote."""
MESH_BYTES = 16 * MIB
"""Size of an STL or OBJ file."""

MODULES = 200
"""Modules of a platform."""
SIZES = 20
"""Numbers of modules that one task asks for."""
LISTED_MODULES = 1_000
"""Modules of trees that are only counted, drawn or listed."""
DRAWN_TREES = 1_000_000
"""Drawn at once."""
LOAD_CASES = 200
FAILURES = 20_000
"""Wrenches that must be possible with some rotor dead, over all rotors, load cases and corners."""
REQUIREMENTS = 20
"""Exposure requirements of a task."""
SEGMENTS = 200
"""Straight pieces of motion paths, planes and convex pieces of all requirements of a task together."""
CORNERS = 100
"""Corners of a convex region, or of one of its pieces: the solver looks at each of them for every module."""
ALL_CORNERS = 2_000
"""Corners of all convex regions of a task together."""
PIECES = 100
"""Convex pieces of a region."""
LEVELS = 1_000
"""Combinations of the levels of all goals: each takes as long as a run of its own."""
HINGE_ANGLES = 1_000
"""Angles of a set that hinges are held to; a step may make more."""

FACETS = 100_000
"""Triangles of a mesh file, polygons cut into triangles; of its vertices there may be three times as many."""
FRAME_PIECES = 100
"""Convex pieces of a module's own frame."""
FRAME_TRIANGLES = 5_000
"""Triangles of all pieces of a module's own frame."""

KEY_PARTS = 30
"""Parts of a dotted key in TOML, and of a field in a setting."""
LISTS = 50_000
"""Opening brackets of a TOML text; a task at all the other limits at once has a third as many."""
WORKERS = 256
"""Processes of one command; each takes as much memory as a solve."""
STARTS = 10_000
"""Starts of a topology."""
TRIALS = 100_000
"""Candidates that a sampler proposes."""
ROUND = 1_000
"""Proposals whose results may be unknown when another is made."""
CANDIDATES = 2_000_000
"""Candidates of one size in an exhaustive search: their table stays within RUN_BYTES."""
OWN_TOPOLOGIES = 10_000
"""That a user lists as the candidates of a run."""
KEYS_BYTES = 4 * MIB
"""Size of a file of keys; one of as many topologies of 200 modules has about half as many bytes."""
NEAR = 100
"""Designs to start from: each is one more start of every candidate."""
OWN_CONSTRAINTS = 100
"""User constraints in one run."""
TREES = 10_000
"""Trees of one size in an experiment."""
CELLS = 20_000
"""Cells of an experiment: its table stays within RESULT_BYTES."""
SECONDS = 1_000_000_000
"""Time limit: 31 years."""
GAPS = (1e-4, 0.5)
"""Least and greatest gap that a proof can be asked for."""
PERCENT = 1000
"""Effort over the best, of designs that are kept or that a kit chooses from [%]."""

LARGEST_INTEGER = 2**63 - 1
"""Seeds and other whole numbers without a range of their own: what TOML promises to every reader."""
