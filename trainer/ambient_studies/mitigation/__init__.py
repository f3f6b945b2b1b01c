"""What the ambient estimate is worth: one governor without and with it, in closed loop on the simulated phone."""
