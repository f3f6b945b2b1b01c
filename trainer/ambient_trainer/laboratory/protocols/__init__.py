"""What goes over an instrument's line: requests to bytes, bytes to replies; no port, clock or file is known here."""
