"""Numbers, counts and names in words, the same wherever a person reads them."""

from __future__ import annotations

EFFORT = "J = Σ_k λ_k ‖u_k‖²"
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def quantity(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def modules(n: int) -> str:
    """Return a number of modules."""
    return quantity(n, "module")


def figures(value: float, digits: int = 4) -> str:
    """Return a number with so many significant digits, a large or small one with a power of ten."""
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text.replace("-", "−")
    mantissa, exponent = text.split("e")
    return f"{mantissa} × 10{str(int(exponent)).translate(SUPERSCRIPTS)}".replace("-", "−")


def length(metres: float) -> str:
    """Return a length in the unit that suits it."""
    if abs(metres) < 0.01:
        return f"{figures(1000 * metres, 3)} mm"
    return f"{figures(100 * metres, 3)} cm" if abs(metres) < 1 else f"{figures(metres, 3)} m"
