"""Closed forms: how many trees there are, and how many of them each turn and mirror leaves as they are.

| symbol | meaning |
|---|---|
| n | number of modules |
| T(x) = 1 + x T(x)^3 | generating function of ternary trees: a slot is free or holds a module with three slots |
| F(n) | fixed trees: nothing but the choice of the root is the same; OEIS A000139 |
| n F(n) | rooted trees: x T(x)^4; OEIS A006629 (offset 1) |
| L, k | modules on the axis of a mirror; pairs of modules beside it, n = L + 2k |

A quotient by a group has (1/|G|) sum over g of Fix(g) classes (Burnside's lemma). For one family there are OEIS
sequences to compare with: C4 is A005034 and D4 is A005036 = (A005034 + A047749) / 2.

With connectors of any port every joint has a parity: a tree counts 2^e times, e the number of joints that can be
chosen freely. As the root's own spin is fixed, c2 then stands for all quarter turns with the spin flip: with the
free root (2^n F(n) + 2^ceil(n/2) Fix180(n)) / 4 classes.
"""

from __future__ import annotations

from math import comb, factorial

from topo_search.topologies.symmetry import GROUPS, Connectors, Group, Root


def forests(trees: int, modules: int) -> int:
    """Return the number of sequences of `trees` >= 1 ternary trees, some perhaps empty: [x^modules] T(x)^trees."""
    return trees * comb(3 * modules + trees, modules) // (3 * modules + trees)


def ternary_trees(modules: int) -> int:
    """Return the number of ternary trees, C(3k, k) / (2k + 1); OEIS A001764."""
    return forests(1, modules)


def fixed_trees(n: int) -> int:
    """Return F(n) = 2 (3n)! / ((2n+1)! (n+1)!); OEIS A000139."""
    return 2 * factorial(3 * n) // (factorial(2 * n + 1) * factorial(n + 1))


def rooted_trees(n: int) -> int:
    """Return n F(n), also 4 C(3n+1, n-1) / (3n+1); OEIS A006629 with offset 1."""
    return n * fixed_trees(n)


def mirror_paths(n: int, *, connectors: Connectors = "aligned", root: Root = "free") -> list[int]:
    """Return, for L = 1..n, the number of trees with L modules on the x axis that are their own mirror image in it.

    They stand in a row, each between a tree and its mirror image: [x^k] T(x)^L. With the paper's root any of the
    L modules can be the root.
    """
    numbers = []
    for on_axis in range(1, n + 1):
        pairs, rest = divmod(n - on_axis, 2)
        number = 0 if rest else forests(on_axis, pairs)
        if connectors == "any":
            number <<= on_axis - 1 + pairs
        numbers.append(number if root == "free" else number * on_axis)
    return numbers


def mirror_bridges(n: int, *, connectors: Connectors = "aligned", root: Root = "free") -> int:
    """Return the number of trees that are mirror images in the x axis of themselves with no module on the axis.

    A joint across the axis, at modules of one spin, holds two mirror images together.
    """
    if n % 2 or root == "paper":
        return 0
    return ternary_trees(n // 2) << (n // 2 - 1 if connectors == "any" else 0)


def count_fixed(
    quarters: int, mirror: bool, n: int, *, connectors: Connectors = "aligned", root: Root = "free"
) -> int:
    """Return the number of trees that an element (q, mirror) of a group leaves as they are."""
    if mirror and quarters % 2 == 0:
        paths = mirror_paths(n, connectors=connectors, root=root)
        return sum(paths) + mirror_bridges(n, connectors=connectors, root=root)
    number, joints = _count_fixed_by_turn(quarters, mirror, n, root)
    return number << joints if connectors == "any" else number


def _count_fixed_by_turn(quarters: int, mirror: bool, n: int, root: Root) -> tuple[int, int]:
    """Return how many aligned trees an element that is no axis mirror leaves as they are, and their free joints."""
    if not mirror and quarters == 0:
        return (fixed_trees(n) if root == "free" else rooted_trees(n)), n - 1
    if not mirror and quarters % 2:  # one tree at all four ports of a centre
        return (ternary_trees(n // 4) if n % 4 == 1 else 0), n // 4
    if n % 2:  # two trees at the ports of a centre, each with its image
        return forests(2, n // 2), n // 2
    if mirror or root == "paper":
        return 0, 0
    return 2 * ternary_trees(n // 2), n // 2 - 1  # a joint along x or y, with the same half at both ends


def classes(n: int, group: Group, *, connectors: Connectors = "aligned", root: Root = "free") -> int:
    """Return the number of trees of n modules up to a group."""
    elements = GROUPS[group]
    return sum(count_fixed(q, mirror, n, connectors=connectors, root=root) for q, mirror in elements) // len(
        elements
    )
