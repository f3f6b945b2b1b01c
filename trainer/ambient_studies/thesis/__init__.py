"""The thesis's ten models, its published parameters and results, and its errata, computed."""
