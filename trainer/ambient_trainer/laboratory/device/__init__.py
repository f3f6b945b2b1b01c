"""The device under test, over a shell on it."""
