"""The discovery benchmark: effects are hidden in simulated runs, and what the diagnosis finds is counted."""
