"""Rounds of starts: ranges that follow each other, short ones first where the time may end in between."""

from __future__ import annotations

from collections.abc import Iterator

LARGEST_TIMED_ROUND = 4
"""Starts a round under a time limit: what runs when it comes is lost."""


def rounds(starts: int | None, size: int, *, timed: bool) -> Iterator[range]:
    """Yield the ranges of starts that are solved one after the other.

    Args:
        starts: how many there are; None: without end.
        size: of a round without a time limit; with one, rounds grow from a single start.
        timed: whether there is a time limit.
    """
    first = 0
    while starts is None or first < starts:
        length = min(max(1, first), LARGEST_TIMED_ROUND) if timed else size
        stop = first + length if starts is None else min(first + length, starts)
        yield range(first, stop)
        first = stop
