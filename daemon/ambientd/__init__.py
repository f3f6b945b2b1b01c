"""Sensors -> estimate -> consumers; standard library and ambient_model only."""
