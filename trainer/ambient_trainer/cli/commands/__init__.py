"""The commands of ``ambient-trainer``: one module a command, found by its name."""
