"""Grey-box models: a circuit with mechanisms, simulated, fitted to runs, and extended by what it lacks."""
