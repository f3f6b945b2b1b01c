"""The public API, one module a verb; ``import ambient_trainer as at`` offers what they hold."""
