"""Grey-box models: a circuit with added mechanisms, simulated, fitted to records, and extended by selection."""
