"""Trees as text, all of one size in ascending order, and the symmetries under which several are one candidate.

A planted tree is the part of a key that describes one module and everything beyond it.

| symbol | meaning | type |
|---|---|---|
| code | preorder text of a planted tree, one hexadecimal digit a module; empty: a free port | str |
| slots 1, 2, 3 | the ports b+1, b+2, b+3 of a module that is entered through its own port b | |
| digit | bits 0..2: which slots carry a child; bit 3: parity of kappa, a spin unlike the parent's | |

Slots are counted from the port of entry, so a code does not change when the whole tree is turned. Codes are
prefix-free and as long as the number of their modules.

| symbol | meaning | type |
|---|---|---|
| Rooted | the codes at the ports 0..3 = +x, +y, -x, -y of the root; empty where a port is free | 4 str |
| text | the digit of the root (bits 0..3: which ports carry a child), then the four codes | str |
| key | `a` or `p` (all kappas even or not), then the text | str |

The root's spin pattern is the standard one in its own frame. Moving the root to a neighbour of odd kappa therefore
turns the frame by a quarter: the same platform, seen from a module whose rotors turn the other way round.

All trees of one size come in ascending order of their texts, in bounded memory: a key's root digit comes first,
then the codes at its ports; codes are prefix-free, so texts ascend when the codes do, port by port. With the root
at a centroid no port carries more than half of the modules: each tree is a combination of short codes.

A symmetry stands for a group:

| symbol | meaning | type |
|---|---|---|
| (q, mirror) | mirror in the x axis if asked, then q quarter turns of the root's frame | int, bool |
| group | c1, c2, d2, c4, d4: the pairs under which keys are one candidate | str |

Half turns and axis mirrors leave every spin pattern as it is, the other four elements of d4 flip it. With
connectors of any port the key's root always has the standard spin, so a quarter turn together with the spin flip is
not a turn of the root's frame but the move of the root to a module of the other spin: c2 and d2 then stand for all
quarter turns, without and with mirrors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from operator import itemgetter
from typing import Literal, get_args

Connectors = Literal["aligned", "any"]
Root = Literal["free", "paper"]

DIGITS = "0123456789abcdef"
CHILDREN = {digit: (mask & 7).bit_count() for mask, digit in enumerate(DIGITS)}
"""Number of children that a digit announces."""
_MIRRORED = {digit: DIGITS[mask & 0b1010 | (mask & 1) << 2 | (mask >> 2) & 1] for mask, digit in enumerate(DIGITS)}


def plant(slots: tuple[str, str, str], odd: int = 0) -> str:
    """Return the code of a module from the codes in its slots 1, 2, 3 and the parity of its own kappa."""
    right, ahead, left = slots
    digit = DIGITS[(right != "") | (ahead != "") << 1 | (left != "") << 2 | odd << 3]
    return digit + right + ahead + left


def split(mask: int, text: str, width: int) -> tuple[str, ...]:
    """Return the codes in `width` slots; `text` holds those in the slots that `mask` names, one after the other."""
    codes, start = [], 0
    for bit in range(width):
        end = start
        waiting = mask >> bit & 1
        while waiting:
            waiting += CHILDREN[text[end]] - 1
            end += 1
        codes.append(text[start:end])
        start = end
    return tuple(codes)


@lru_cache(maxsize=1 << 14)
def mirror_code(code: str) -> str:
    """Return the code of the mirror image, which swaps slots 1 and 3 of every module."""
    waiting: list[str] = []
    for digit in reversed(code):
        children = [waiting.pop() for _ in range(CHILDREN[digit])]
        waiting.append(_MIRRORED[digit] + "".join(reversed(children)))
    return "".join(waiting)


def codes(least: int, most: int, connectors: Connectors) -> Iterable[str]:
    """Return the codes of `least` to `most` modules in ascending order."""
    if most <= 5:  # 343 aligned codes, 9,726 of any port: kept; longer lists are made anew
        return _kept_codes(least, most, connectors)
    return _grow(least, most, connectors)


@cache
def _kept_codes(least: int, most: int, connectors: Connectors) -> tuple[str, ...]:
    return tuple(_grow(least, most, connectors))


def _grow(least: int, most: int, connectors: Connectors) -> Iterator[str]:
    """Write codes digit by digit, depth first; every beginning that is kept can be completed."""
    descending = (DIGITS if connectors == "any" else DIGITS[:8])[::-1]
    stack = [("", 1)]
    while stack:
        code, waiting = stack.pop()
        if not waiting:
            yield code
            continue
        size = len(code) + 1
        for digit in descending:
            left = waiting - 1 + CHILDREN[digit]
            if size + left <= most and (left or size >= least):
                stack.append((code + digit, left))


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


def rooted_at(root: Root, n: int, connectors: Connectors, masks: Iterable[int]) -> Iterator[Rooted]:
    """Yield the rooted trees of n modules in ascending order of their texts.

    With the free root: those with the root at a centroid, so that a tree with two centroids comes twice.

    Args:
        root: `free`, or `paper`.
        n: number of modules.
        connectors: the family of trees.
        masks: which ports of the root may carry a child (bits 0..3), in ascending order.
    """
    most = n - 1 if root == "paper" else n // 2
    for mask in masks:
        ports = mask.bit_count()
        # a free port's code is the empty one behind the row's end
        at_four = itemgetter(
            *((mask & (1 << port) - 1).bit_count() if mask >> port & 1 else ports for port in range(4))
        )
        for at_ports in _rows(ports, n - 1, most, connectors):
            yield at_four((*at_ports, ""))


def _rows(ports: int, modules: int, most: int, connectors: Connectors) -> Iterator[tuple[str, ...]]:
    """Yield the rows of `ports` codes of at most `most` modules each and `modules` in all, in ascending order."""
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
"""Symmetries that a user can ask for; `task` is the coarsest quotient that is exact for the task."""
Group = Literal["c1", "c2", "d2", "c4", "d4"]

Element = tuple[int, bool]

GROUPS: dict[Group, tuple[Element, ...]] = {
    "c1": ((0, False),),
    "c2": ((0, False), (2, False)),
    "d2": ((0, False), (2, False), (0, True), (2, True)),
    "c4": tuple((q, False) for q in range(4)),
    "d4": tuple((q, mirror) for mirror in (False, True) for q in range(4)),
}
"""The elements (q, mirror) of each group, the identity first."""


def group_of(symmetry: Symmetry, *, connectors: Connectors, root: Root, mirrors: bool | None = None) -> Group:
    """Return the group under which keys are one candidate.

    Args:
        symmetry: what was asked for.
        connectors: with `any`, every name but `none` and `task` means the quarter turn with spin flip.
        root: with `paper`, `task` means the identity, the only exact one.
        mirrors: whether an improper isometry maps the task onto itself; needed by `task` with a free root.

    Raises:
        ValueError: an unknown name, or `task` without `mirrors`.
    """
    for name, value, known in (
        ("symmetry", symmetry, Symmetry),
        ("connectors", connectors, Connectors),
        ("root", root, Root),
    ):
        if value not in get_args(known):
            raise ValueError(f"{name} must be one of {', '.join(get_args(known))}, but got {value!r}")
    if symmetry == "none":
        return "c1"
    if symmetry == "task":
        if root == "paper":
            return "c1"
        if mirrors is None:
            raise ValueError('symmetry "task" is found from a task, but none was given')
        return "d2" if mirrors else "c2"
    return "c2" if connectors == "any" else symmetry


def image(rooted: Rooted, element: Element) -> Rooted:
    """Return what an element (q, mirror) of a group makes of a tree."""
    quarters, mirror = element
    return turn(reflect(rooted) if mirror else rooted, quarters)


@cache
def stabilizers(group: Group) -> Mapping[int, tuple[Element, ...]]:
    """Return the masks that no element takes to a lesser one, each with those that leave it, but the identity."""
    kept = {}
    for mask in range(16):
        east, north, west, south = ("0" if mask >> port & 1 else "" for port in range(4))
        images = {
            element: int(text_of(image((east, north, west, south), element))[0], 16) for element in GROUPS[group]
        }
        if min(images.values()) == mask:
            kept[mask] = tuple(element for element, image in images.items() if image == mask and any(element))
    return kept
