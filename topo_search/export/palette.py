"""Colours of the pictures: the set of Okabe and Ito, told apart with every kind of colour vision.

M. Okabe, K. Ito, "Color Universal Design", 2008.
"""

MODULE = "#262626"
ARM = "#6b6b6b"
ROTOR = "#c9c9c9"
THRUST_AXIS = "#d55e00"
CONNECTOR = "#0072b2"
FREE_PORT = "#b0b0b0"
AIRFLOW = "#cc79a7"
EXPOSURE = "#e69f00"
END_EFFECTOR = "#009e73"
CENTRE_OF_MASS = "#f0e442"
OFFSET = "#56b4e9"
