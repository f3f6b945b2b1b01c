"""Files of other loggers become traces: one module a format."""
