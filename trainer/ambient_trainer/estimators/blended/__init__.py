"""Observers of a device: filters taught by what a forward circuit of it makes up beside one logged run."""
