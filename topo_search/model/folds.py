"""Folds of hinges, and ranges of them.

The fold of a hinge is its angle with a sign that does not depend on the ports: positive if the upper sides of the
two modules lean towards each other and their airflows apart.
"""

import math

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.proven import excess_texts

LENGTH_ROUNDING = 1e-9
"""Allowance for rounding, relative to a length, or for an angle [rad]."""

Folds = tuple[tuple[float, float], ...]
"""Closed intervals of fold angles, in ascending order [rad]."""

FOLD = (-1.0, 1.0, 1.0, -1.0)
"""Sign of the fold of a positive hinge angle at the parent's port +x, +y, -x, -y."""


def nearest_fold(folds: Folds, phi: Array) -> Array:
    """Return the clear fold nearest to each angle; 0 if no fold is clear."""
    if not folds:
        return np.zeros_like(phi)
    clipped = np.array([np.clip(phi, low, high) for low, high in folds])
    choice = np.argmin(np.abs(clipped - phi), axis=0)
    return np.asarray(np.take_along_axis(clipped, choice[None], axis=0)[0])


def intersect(some: Folds, others: Folds) -> Folds:
    """Return the intersection of two sets of intervals."""
    both = ((max(a, c), min(b, d)) for a, b in some for c, d in others)
    return tuple(sorted((low, high) for low, high in both if low <= high))


def folds_text(folds: Folds, unit: str) -> str:
    """Return the ranges of folds in words, in degrees with a suffix for the unit, rounded to the safe side."""
    mirrored = tuple((-high, -low) for low, high in reversed(folds)) == folds
    ranges = [(max(low, 0.0), high) for low, high in folds if high > 0] if mirrored else folds
    limits = [excess_texts(math.degrees(high), math.degrees(low), 3) for low, high in ranges]
    texts = [f"{low} to {high}{unit}" for high, low in limits]
    if mirrored and ranges[0][0] == 0:
        texts[0] = f"at most {limits[0][0]}{unit}"
    text = " or ".join(texts)
    return text if mirrored else f"{text}, positive if airflows lean apart"


def join(intervals: list[tuple[float, float]]) -> Folds:
    """Return the union of intervals, with adjacent ones joined."""
    joined: list[tuple[float, float]] = []
    for low, high in sorted(intervals):
        if joined and low - joined[-1][1] < LENGTH_ROUNDING:
            low, _ = joined.pop()
        joined.append((low, high))
    limit = math.pi / 2
    return tuple(
        (-limit if limit + low < LENGTH_ROUNDING else low, limit if limit - high < LENGTH_ROUNDING else high)
        for low, high in joined
    )
