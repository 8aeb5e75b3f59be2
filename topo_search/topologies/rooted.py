"""Trees as text, enumeration in ascending order, and the symmetries under which trees are one candidate.

A planted tree is the part of a key that describes a module and all of its descendants.

| symbol | meaning | type |
|---|---|---|
| code | preorder text of a planted tree, one hexadecimal digit per module; empty: a free port | str |
| slots 1, 2, 3 | ports b+1, b+2, b+3 of a module with the child port b | |
| digit | bits 0..2: slots with a child; bit 3: parity of kappa, 1 if the spins differ from the parent's | |

Slots are counted from the child port, so a code does not change when the whole tree is turned. Codes are
prefix-free, and their length is the number of modules.

| symbol | meaning | type |
|---|---|---|
| Rooted | codes at the ports 0..3 = +x, +y, -x, -y of the root; empty if a port is free | 4 str |
| text | digit of the root (bits 0..3: ports with a child), then the four codes | str |
| key | `a` (all kappas even) or `p`, then the text | str |

The root has the standard spin pattern in its own frame. So moving the root to a neighbour with an odd kappa turns
the frame by a quarter turn: the same platform, seen from a module whose rotors spin in the opposite sense.

All trees of one size are enumerated in ascending order of their texts, in bounded memory: the root digit comes
first, then the codes at its ports; codes are prefix-free, so texts ascend if the codes do, port by port. With the
root at a centroid no port carries more than half of the modules, so that each tree is a combination of short codes.

A symmetry names a group:

| symbol | meaning | type |
|---|---|---|
| (q, mirror) | mirror in the x axis if true, then q quarter turns of the root's frame | int, bool |
| group | c1, c2, d2, c4, d4: pairs (q, mirror) under which keys are one candidate | str |

Half turns and axis mirrors preserve every spin pattern; the other four elements of d4 flip it. With connectors of
any port the key's root always has the standard spin, so a quarter turn with spin flip does not turn the root's
frame, but moves the root to a module of the other spin: c2 and d2 then mean all quarter turns, without and with
mirrors.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from operator import itemgetter
from typing import Literal, get_args

Connectors = Literal["aligned", "any"]
Root = Literal["free", "paper"]

DIGITS = "0123456789abcdef"
CHILDREN = {digit: (mask & 7).bit_count() for mask, digit in enumerate(DIGITS)}
"""Number of children of a module with this digit."""
_MIRRORED = {digit: DIGITS[mask & 0b1010 | (mask & 1) << 2 | (mask >> 2) & 1] for mask, digit in enumerate(DIGITS)}


def plant(slots: tuple[str, str, str], odd: int = 0) -> str:
    """Return the code of a module from the codes in its slots 1, 2, 3 and the parity of its kappa."""
    right, ahead, left = slots
    digit = DIGITS[(right != "") | (ahead != "") << 1 | (left != "") << 2 | odd << 3]
    return digit + right + ahead + left


def split(mask: int, text: str, width: int) -> tuple[str, ...]:
    """Return the codes in `width` slots, given the set of occupied slots and their concatenated codes."""
    codes, start = [], 0
    for bit in range(width):
        end = start
        open_slots = mask >> bit & 1
        while open_slots:
            open_slots += CHILDREN[text[end]] - 1
            end += 1
        codes.append(text[start:end])
        start = end
    return tuple(codes)


@lru_cache(maxsize=1 << 14)
def mirror_code(code: str) -> str:
    """Return the code of the mirror image: slots 1 and 3 of every module are swapped."""
    stack: list[str] = []
    for digit in reversed(code):
        children = [stack.pop() for _ in range(CHILDREN[digit])]
        stack.append(_MIRRORED[digit] + "".join(reversed(children)))
    return "".join(stack)


def codes(least: int, most: int, connectors: Connectors) -> Iterable[str]:
    """Return the codes of `least` to `most` modules in ascending order."""
    if most <= 5:  # 343 aligned codes, 9,726 of any port: cached
        return _cached_codes(least, most, connectors)
    return _grow(least, most, connectors)


@cache
def _cached_codes(least: int, most: int, connectors: Connectors) -> tuple[str, ...]:
    return tuple(_grow(least, most, connectors))


def _grow(least: int, most: int, connectors: Connectors) -> Iterator[str]:
    """Yield codes, built digit by digit, depth first; every prefix on the stack can be completed."""
    descending = (DIGITS if connectors == "any" else DIGITS[:8])[::-1]
    stack = [("", 1)]
    while stack:
        code, open_slots = stack.pop()
        if not open_slots:
            yield code
            continue
        size = len(code) + 1
        for digit in descending:
            remaining = open_slots - 1 + CHILDREN[digit]
            if size + remaining <= most and (remaining or size >= least):
                stack.append((code + digit, remaining))


Rooted = tuple[str, str, str, str]


def text_of(rooted: Rooted) -> str:
    """Return the text of a tree; texts of one size compare like keys with the same first letter."""
    east, north, west, south = rooted
    digit = DIGITS[(east != "") | (north != "") << 1 | (west != "") << 2 | (south != "") << 3]
    return digit + east + north + west + south


def key_of(text: str) -> str:
    """Return the key of a text."""
    return ("p" if max(text[1:], default="0") >= "8" else "a") + text


def rooted_of(key: str) -> Rooted:
    """Return the rooted tree of a key."""
    east, north, west, south = split(int(key[1], 16), key[2:], 4)
    return east, north, west, south


def size_of(rooted: Rooted) -> int:
    """Return the number of modules."""
    return 1 + sum(map(len, rooted))


def turn(rooted: Rooted, quarters: int) -> Rooted:
    """Return the tree turned counterclockwise by quarter turns, with the root's spins unchanged."""
    shift = -quarters % 4
    east, north, west, south = rooted[shift:] + rooted[:shift]
    return east, north, west, south


def reflect(rooted: Rooted) -> Rooted:
    """Return the mirror image in the x axis; every module keeps the spin pattern in its own frame."""
    east, north, west, south = rooted
    return mirror_code(east), mirror_code(south), mirror_code(west), mirror_code(north)


def reroot(rooted: Rooted, port: int) -> Rooted:
    """Return the tree rooted at the neighbour at a port, in the neighbour's frame."""
    first, second, third = (rooted[(port + slot) % 4] for slot in (1, 2, 3))
    code = rooted[port]
    mask = int(code[0], 16)
    odd = mask >> 3
    right, ahead, left = split(mask, code[1:], 3)
    # the neighbour's slots follow counterclockwise from its child port, which points to port + 2
    return turn((plant((first, second, third), odd), right, ahead, left), port + 2 - odd)


def heaviest(rooted: Rooted) -> int:
    """Return the port with the most modules."""
    sizes = tuple(map(len, rooted))
    return sizes.index(max(sizes))


def centre(rooted: Rooted) -> Rooted:
    """Return the tree rooted at a centroid: no port carries more than half of the modules."""
    n = size_of(rooted)
    while 2 * len(rooted[port := heaviest(rooted)]) > n:
        rooted = reroot(rooted, port)
    return rooted


def other_centroid(rooted: Rooted) -> int | None:
    """Return the port of a centroid root that leads to a second centroid, if any: it has half of the modules."""
    port = heaviest(rooted)
    return port if 2 * len(rooted[port]) == size_of(rooted) else None


def rooted_at(root: Root, n: int, connectors: Connectors, masks: Iterable[int]) -> Iterator[Rooted]:
    """Yield the rooted trees of n modules in ascending order of their texts.

    With the free root: those rooted at a centroid, so that a tree with two centroids appears twice.

    Args:
        root: `free`, or `paper`.
        n: number of modules.
        connectors: `aligned`, or `any`.
        masks: sets of occupied ports of the root (bits 0..3), in ascending order.
    """
    most = n - 1 if root == "paper" else n // 2
    for mask in masks:
        ports = mask.bit_count()
        # free ports take the empty code appended to the row
        at_four = itemgetter(
            *((mask & (1 << port) - 1).bit_count() if mask >> port & 1 else ports for port in range(4))
        )
        for at_ports in _rows(ports, n - 1, most, connectors):
            yield at_four((*at_ports, ""))


def _rows(ports: int, modules: int, most: int, connectors: Connectors) -> Iterator[tuple[str, ...]]:
    """Yield tuples of `ports` codes, at most `most` modules each and `modules` in total, in ascending order."""
    if not ports <= modules <= ports * most:
        return
    if ports == 0:
        yield ()
        return
    if ports == 1:
        yield from zip(codes(modules, modules, connectors))
        return
    least = max(1, modules - (ports - 1) * most)
    for code in codes(least, min(most, modules - ports + 1), connectors):
        for row in _rows(ports - 1, modules - len(code), most, connectors):
            yield (code, *row)


Symmetry = Literal["task", "none", "c2", "d2", "c4", "d4"]
"""Symmetries of the public interface; `task`: the coarsest quotient that is exact for the task."""
Group = Literal["c1", "c2", "d2", "c4", "d4"]

Element = tuple[int, bool]

GROUPS: dict[Group, tuple[Element, ...]] = {
    "c1": ((0, False),),
    "c2": ((0, False), (2, False)),
    "d2": ((0, False), (2, False), (0, True), (2, True)),
    "c4": tuple((q, False) for q in range(4)),
    "d4": tuple((q, mirror) for mirror in (False, True) for q in range(4)),
}
"""Elements (q, mirror) of each group, the identity first."""


def group_of(symmetry: Symmetry, *, connectors: Connectors, root: Root, exact: Group | None = None) -> Group:
    """Return the group under which keys are one candidate.

    Args:
        symmetry: requested symmetry.
        connectors: with `any`, all names except `none` and `task` mean the quarter turn with spin flip.
        root: with `paper`, `task` means the identity, the only exact symmetry.
        exact: largest exact group of the task; required by `task` with a free root.

    Raises:
        ValueError: an unknown name, or `task` without `exact`.
    """
    for name, value, names in (
        ("symmetry", symmetry, Symmetry),
        ("connectors", connectors, Connectors),
        ("root", root, Root),
    ):
        if value not in get_args(names):
            raise ValueError(f"{name} must be one of {', '.join(get_args(names))}, but got {value!r}")
    if symmetry == "none":
        return "c1"
    if symmetry == "task":
        if root == "paper":
            return "c1"
        if exact is None:
            raise ValueError('symmetry "task" requires a task, but none was given')
        return exact
    return "c2" if connectors == "any" else symmetry


def image(rooted: Rooted, element: Element) -> Rooted:
    """Return the image of a tree under an element (q, mirror) of a group."""
    quarters, mirror = element
    return turn(reflect(rooted) if mirror else rooted, quarters)


@cache
def stabilizers(group: Group) -> Mapping[int, tuple[Element, ...]]:
    """Return the root masks that are the smallest of their orbit, with their stabilizers without the identity."""
    result = {}
    for mask in range(16):
        east, north, west, south = ("0" if mask >> port & 1 else "" for port in range(4))
        images = {
            element: int(text_of(image((east, north, west, south), element))[0], 16) for element in GROUPS[group]
        }
        if min(images.values()) == mask:
            result[mask] = tuple(element for element, image in images.items() if image == mask and any(element))
    return result
