"""The laboratory: campaigns run on a chamber, a multiplexer, a thermometer and a device, real or simulated."""
