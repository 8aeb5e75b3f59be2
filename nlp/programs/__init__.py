"""The printed problem as a nonlinear program, and Ipopt."""
