"""Partial pooling over thousands of units: a population estimated from all, each unit from its own log and that."""
