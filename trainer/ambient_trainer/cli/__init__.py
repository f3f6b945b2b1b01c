"""The command line: one module a command, each a thin call into the package that does the work."""
