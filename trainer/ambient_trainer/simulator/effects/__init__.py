"""Effects that can be hidden in a simulated run, one file each; the truth about them never enters the trace."""
