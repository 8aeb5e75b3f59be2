"""Counts in words. `--help` loads this file too, and so it loads nothing itself."""


def quantity(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
