"""Thousands of units: what they share is learnt from all of them, what is a unit's own from its own log."""
