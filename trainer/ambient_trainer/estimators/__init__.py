"""Fitted systems become model files."""
