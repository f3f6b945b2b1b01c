"""Effects hidden in a simulated run, for a diagnosis to find; the truth about them never enters the trace."""
