"""Planted trees as text: the part of a key that describes one module and everything beyond it.

| symbol | meaning | type |
|---|---|---|
| code | preorder text of a planted tree, one hexadecimal digit a module; empty: a free port | str |
| slots 1, 2, 3 | the ports b+1, b+2, b+3 of a module that is entered through its own port b | |
| digit | bits 0..2: which slots carry a child; bit 3: parity of kappa, a spin unlike the parent's | |

Slots are counted from the port of entry, so a code does not change when the whole tree is turned. Codes are
prefix-free and as long as the number of their modules.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache, lru_cache

from topo_search.topologies.symmetry import Connectors

DIGITS = "0123456789abcdef"
CHILDREN = {digit: (mask & 7).bit_count() for mask, digit in enumerate(DIGITS)}
"""Number of children that a digit announces."""
_MIRRORED = {digit: DIGITS[mask & 0b1010 | (mask & 1) << 2 | (mask >> 2) & 1] for mask, digit in enumerate(DIGITS)}
LONGEST_KEPT = 5
"""Lists of codes up to this many modules are kept (343 aligned codes, 9,726 of any port), longer ones made anew."""


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
    if most <= LONGEST_KEPT:
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
        begun, waiting = stack.pop()
        if not waiting:
            yield begun
            continue
        size = len(begun) + 1
        for digit in descending:
            left = waiting - 1 + CHILDREN[digit]
            if size + left <= most and (left or size >= least):
                stack.append((begun + digit, left))
