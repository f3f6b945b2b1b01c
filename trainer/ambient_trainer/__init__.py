"""Traces -> circuit -> fit -> evaluation and export."""
