"""The symmetries that can be asked for, and the group that each stands for.

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

from typing import Literal, get_args

Symmetry = Literal["task", "none", "c2", "d2", "c4", "d4"]
"""Symmetries that a user can ask for; `task` is the coarsest quotient that is exact for the task."""
Connectors = Literal["aligned", "any"]
Root = Literal["free", "paper"]
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
