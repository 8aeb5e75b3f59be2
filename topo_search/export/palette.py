"""Colours of the pictures: the set of Okabe and Ito, told apart with every kind of colour vision.

M. Okabe, K. Ito, "Color Universal Design", 2008.
"""

MODULE = "#262626"
ARM = "#6b6b6b"
ROTOR = "#c9c9c9"
THRUST_AXIS = "#d55e00"
SPINS = ("#56b4e9", "#cc79a7")
"""Rotors that turn counter-clockwise and clockwise, seen from above."""
CONNECTOR = "#0072b2"
FREE_PORT = "#b0b0b0"
AIRFLOW = "#cc79a7"
AIR = "#56b4e9"
EXPOSURE = "#e69f00"
WALL = "#b3aa9e"
END_EFFECTOR = "#009e73"
CENTRE_OF_MASS = "#f0e442"
OFFSET = "#56b4e9"
CLOSEST_PAIR = "#000000"
WRENCH = "#000000"
CONTACT = "#56b4e9"
BLOCKED_PORT = "#f0e442"

VERDICTS = {"clear": "#009e73", "undecided": "#e69f00", "violated": "#d55e00", "inconsistent": "#000000"}
"""Colours of audit verdicts, always beside the word."""
STATUSES = {"feasible": "#009e73", "infeasible": "#e69f00", "impossible": "#cc79a7", "failed": "#000000"}
"""Colours of candidates' statuses, always beside the word."""
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Lines and points of one chart, told apart by their markers too."""
CASES = ("#000000", "#cc79a7", "#009e73", "#e69f00", "#56b4e9")
"""Arrows of load cases beside thrust axes and joints."""

CELL = "rgba(128, 128, 128, 0.12)"
TIGHT = "#ffd166"
NOT_CLEAR = "#a84700"
"""Cells of a matrix of clearances: plain, tight, not clear."""
IN_CELLS = ("#222222", "#221c10", "#fffffe")
"""Text in them, with a contrast of 4.5 at least."""
