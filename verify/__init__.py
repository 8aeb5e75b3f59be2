"""The exact audit of a design; shares no code with the solver."""
