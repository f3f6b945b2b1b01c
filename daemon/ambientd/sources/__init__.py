"""Where samples come from: the device's sensors or a trace."""
