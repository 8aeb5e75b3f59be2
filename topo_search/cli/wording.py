"""Counts in words."""


def counted(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def modules(n: int) -> str:
    """Return a number of modules."""
    return counted(n, "module")
