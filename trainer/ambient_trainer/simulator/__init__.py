"""Simulated devices and the scenarios they go through; all that comes from here is called simulated."""
