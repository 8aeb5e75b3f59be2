"""The symmetries that can be asked for: the group that each stands for, and the trees that are then one candidate.

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
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Literal, get_args

from topo_search.topologies.rooted import (
    Connectors,
    Root,
    Rooted,
    centre,
    other_centroid,
    reflect,
    reroot,
    text_of,
    turn,
)

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


@dataclass(frozen=True)
class Quotient:
    """Trees taken for one candidate.

    With the paper's root a tree is its rooted tree. With the free root a tree is represented by the trees rooted at
    its centroids, of which there are one or (next to each other, for even n) two.
    """

    group: Group
    """The turns and mirrors under which trees are one."""
    root: Root
    """`free`: trees are one also if only their root differs."""

    def representative(self, rooted: Rooted) -> Rooted:
        """Return the tree with the least text among those that are one candidate with a given one."""
        return min(self.equivalents(rooted if self.root == "paper" else centre(rooted)), key=text_of)

    @property
    def masks(self) -> Iterable[int]:
        """Masks of the root's ports with a child (bits 0..3) in trees that are their own representatives."""
        return _stabilizers(self.group)

    def lists(self, rooted: Rooted) -> bool:
        """True if a tree (free root: one rooted at a centroid) is its own representative."""
        text = text_of(rooted)
        stabilizer = _stabilizers(self.group).get(int(text[0], 16))
        # the root's digit comes first in a text: all other elements lead to a greater one
        if stabilizer is None or any(text_of(_image(rooted, element)) < text for element in stabilizer):
            return False
        first, *second = self._rootings(rooted)
        return first == rooted and all(
            text <= text_of(_image(other, element)) for other in second for element in GROUPS[self.group]
        )

    def orbit(self, rooted: Rooted) -> int:
        """Return the number of exact classes that are one candidate with a tree (free root: rooted at a centroid).

        Exact are half turns with the free root (for any port: quarter turns with spin flip), and the identity with
        the paper's root. Without any symmetry asked for the answer is 1.
        """
        if self._exact == self:
            return 1
        rest, classes = set(self.equivalents(rooted)), 0
        while rest:
            rest.difference_update(self._exact.equivalents(rest.pop()))
            classes += 1
        return classes

    def equivalents(self, rooted: Rooted) -> Iterator[Rooted]:
        """Yield the rooted trees that are one candidate with a given one (free root: rooted at a centroid)."""
        for tree in self._rootings(rooted):
            for element in GROUPS[self.group]:
                yield _image(tree, element)

    @cached_property
    def _exact(self) -> Quotient:
        return Quotient("c1" if self.root == "paper" or self.group == "c1" else "c2", self.root)

    def _rootings(self, rooted: Rooted) -> tuple[Rooted, ...]:
        """Return the tree rooted at each of its centroids."""
        port = None if self.root == "paper" else other_centroid(rooted)
        if port is None:
            return (rooted,)
        other = reroot(rooted, port)
        if self.group == "c1" and rooted[port] >= "8":
            # Centroids of unlike spins see the tree a quarter turn apart, so no frame is common to both. The one
            # with the lesser key up to a half turn is the root, and its two half turns are listed.
            return (min(rooted, other, key=lambda tree: min(text_of(tree), text_of(turn(tree, 2)))),)
        return (rooted, other)


def _image(rooted: Rooted, element: Element) -> Rooted:
    quarters, mirror = element
    return turn(reflect(rooted) if mirror else rooted, quarters)


@cache
def _stabilizers(group: Group) -> Mapping[int, tuple[Element, ...]]:
    """Return the masks that no element takes to a lesser one, each with those that leave it, but the identity."""
    stabilizers = {}
    for mask in range(16):
        east, north, west, south = ("0" if mask >> port & 1 else "" for port in range(4))
        images = {
            element: int(text_of(_image((east, north, west, south), element))[0], 16) for element in GROUPS[group]
        }
        if min(images.values()) == mask:
            stabilizers[mask] = tuple(
                element for element, image in images.items() if image == mask and any(element)
            )
    return stabilizers
