"""Observers of the ambient: filters that know what an ambient and noise are, beside the circuits of the thesis."""
