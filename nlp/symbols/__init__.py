"""The paper's formulas as CasADi expressions: poses, wrenches, smooth clearances."""
