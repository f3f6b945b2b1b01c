"""How good a linear filter could be: fitted to the very scenario it is scored on, and allowed to see more."""
