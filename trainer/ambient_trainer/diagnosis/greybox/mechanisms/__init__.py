"""Mechanisms that a circuit may lack: one file each, found by their place; each gives its candidates for a scene."""
