"""Where samples come from: the device's thermal zones or a trace."""
