"""Air speeds over regions: limits, their rows in a program and in the search, and bounds."""
