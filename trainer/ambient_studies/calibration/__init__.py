"""Fits the simulated phone to what can be recovered from the thesis, and says how well that went."""
