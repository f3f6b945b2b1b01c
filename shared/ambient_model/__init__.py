"""What a model file and a trace are, and what they mean; standard library only."""

__version__ = "0.1.0"
