"""Recipes: filters fitted to a log and to synthetic runs of a forward circuit that is fitted to the same log."""
