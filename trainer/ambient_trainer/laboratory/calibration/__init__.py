"""Calibration of probes against a reference thermometer in one bath."""
