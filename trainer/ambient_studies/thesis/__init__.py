"""The thesis: its models, parameters, results and errata, its related methods, and all of it on a simulated phone."""
