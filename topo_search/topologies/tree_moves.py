"""Moves from one tree to another: a part is cut off and grafted elsewhere, or a connector's parity is flipped.

| symbol | meaning | range |
|---|---|---|
| i | module that is cut off, with everything beyond it: the part | 1..n-1 |
| (h, a) | port a of module h that the part is grafted at; h is not in the part | |
| kappa[i] | quarter turns of module i about its z axis relative to the aligned joint | 0..3 |
| shift | quarter turns by which all ports of the part move on: a' - a - (change of kappa[i]) | 0..3 |

Moving all ports of the part by the same number leaves its own joints as they are: spins change only in the part as
a whole, and only with the parity of kappa[i]. A part of one module is a leaf; moves of leaves alone lead from any
aligned tree to any other of the same size.
"""

from __future__ import annotations

from random import Random

from topo_search.model import Topology
from topo_search.topologies.symmetry import Connectors

Move = tuple[int, tuple[int, int], int]
"""i, (h, a) and the quarter turns that kappa[i] grows by: what `graft` takes beside a tree."""


def graft(topology: Topology, i: int, at: tuple[int, int], turns: int = 0) -> Topology:
    """Return a tree in which the part at module i is joined to another port, or to its own again.

    Args:
        topology: the tree before the move.
        i: the module that is cut off, with everything beyond it.
        at: (h, a), the port of a module outside of the part; free, or that of module i so far.
        turns: quarter turns that kappa[i] grows by; an odd number flips the part's spins.

    Raises:
        ValueError: the port belongs to the part or is taken, or i is the root.
    """
    if not 0 < i < topology.n:
        raise ValueError(f"`0 < i < {topology.n}` must hold, but got i = {i}")
    part = part_of(topology, i)
    if at[0] in part:
        raise ValueError(f"module {at[0]} goes with module {i}, but got at = {at}")
    shift = (at[1] - topology.joints[i][1] - turns) % 4
    order = [h for h in range(topology.n) if h not in part] + sorted(part)
    index = {old: new for new, old in enumerate(order)}
    joints = [topology.joints[0]]
    for old in order[1:]:
        h, a, b = topology.joints[old]
        if old == i:
            joints.append((index[at[0]], at[1], (b + shift) % 4))
        elif old in part:
            joints.append((index[h], (a + shift) % 4, (b + shift) % 4))
        else:
            joints.append((index[h], a, b))
    return Topology(tuple(joints))


def with_spins_reversed(topology: Topology) -> Topology:
    """Return the tree whose rotors all turn the other way: every joint sits one port further on."""
    first, *joints = topology.joints
    return Topology((first, *((h, (a + 1) % 4, (b + 1) % 4) for h, a, b in joints)))


def part_of(topology: Topology, i: int) -> frozenset[int]:
    """Return module i and everything beyond it, as seen from the root."""
    part = {i}
    for child, parent in enumerate(topology.parents[i + 1 :], start=i + 1):
        if parent in part:
            part.add(child)
    return frozenset(part)


def draw_move(topology: Topology, random: Random, connectors: Connectors) -> Move:
    """Return a move: of a leaf or any other part, or (any port) a parity that is flipped.

    Args:
        topology: a tree of two modules at least.
        random: draws the move.
        connectors: with `any`, half of the moves flip the parity of a joint, in place or with a move of its part.

    Raises:
        ValueError: there is one module alone, and nothing can be moved.
    """
    if topology.n < 2:
        raise ValueError("`n >= 2` must hold for a move, but got n = 1")
    parents = set(topology.parents)
    leaves = [i for i in range(1, topology.n) if i not in parents]
    i = random.choice(leaves) if random.random() < 0.5 else random.randrange(1, topology.n)
    turns = random.randrange(2) if connectors == "any" else 0
    if turns and random.randrange(2):
        return i, topology.joints[i][:2], turns
    part = part_of(topology, i)
    ports = [port for port in topology.free_connectors if port[0] not in part]
    return i, random.choice(ports), turns
