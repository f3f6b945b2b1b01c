"""Linear time-invariant systems: discretisation, responses, Riccati equation, balanced truncation."""
