"""Rooted trees as four codes, and what turning, mirroring and moving the root do to them.

| symbol | meaning | type |
|---|---|---|
| Rooted | the codes at the ports 0..3 = +x, +y, -x, -y of the root; empty where a port is free | 4 str |
| text | the digit of the root (bits 0..3: which ports carry a child), then the four codes | str |
| key | `a` or `p` (all kappas even or not), then the text | str |

The root's spin pattern is the standard one in its own frame. Moving the root to a neighbour of odd kappa therefore
turns the frame by a quarter: the same platform, seen from a module whose rotors turn the other way round.
"""

from __future__ import annotations

from topo_search.topologies.codes import DIGITS, mirror_code, plant, split

Rooted = tuple[str, str, str, str]


def text_of(rooted: Rooted) -> str:
    """Return the text; texts of one size compare like keys that start with the same letter."""
    east, north, west, south = rooted
    digit = DIGITS[(east != "") | (north != "") << 1 | (west != "") << 2 | (south != "") << 3]
    return digit + east + north + west + south


def key_of(text: str) -> str:
    """Return the key of a text."""
    return ("p" if max(text[1:], default="0") >= "8" else "a") + text


def rooted_of(key: str) -> Rooted:
    """Return the four codes of a key."""
    east, north, west, south = split(int(key[1], 16), key[2:], 4)
    return east, north, west, south


def size_of(rooted: Rooted) -> int:
    """Return the number of modules."""
    return 1 + sum(map(len, rooted))


def turn(rooted: Rooted, quarters: int) -> Rooted:
    """Return the tree turned counterclockwise by quarter turns, with the root's spins left as they are."""
    shift = -quarters % 4
    east, north, west, south = rooted[shift:] + rooted[:shift]
    return east, north, west, south


def reflect(rooted: Rooted) -> Rooted:
    """Return the mirror image in the x axis. Every module keeps its spin pattern in its own frame."""
    east, north, west, south = rooted
    return mirror_code(east), mirror_code(south), mirror_code(west), mirror_code(north)


def reroot(rooted: Rooted, port: int) -> Rooted:
    """Return the same tree with the neighbour at a port as its root, in the neighbour's own frame."""
    first, second, third = (rooted[(port + slot) % 4] for slot in (1, 2, 3))
    code = rooted[port]
    mask = int(code[0], 16)
    odd = mask >> 3
    right, ahead, left = split(mask, code[1:], 3)
    # the neighbour's slots lie counterclockwise from where it was entered, which is at port + 2
    return turn((plant((first, second, third), odd), right, ahead, left), port + 2 - odd)


def heaviest(rooted: Rooted) -> int:
    """Return the port that carries most modules."""
    sizes = tuple(map(len, rooted))
    return sizes.index(max(sizes))


def centre(rooted: Rooted) -> Rooted:
    """Return the same tree rooted at a centroid: no port carries more than half of the modules."""
    n = size_of(rooted)
    while 2 * len(rooted[port := heaviest(rooted)]) > n:
        rooted = reroot(rooted, port)
    return rooted


def other_centroid(rooted: Rooted) -> int | None:
    """Return the port of a centroid root at which half of the modules hang, if there is one.

    The module there is the second centroid.
    """
    port = heaviest(rooted)
    return port if 2 * len(rooted[port]) == size_of(rooted) else None
