"""Exact numeric formulas: poses, clearances, masses, air, and points of the problem."""
