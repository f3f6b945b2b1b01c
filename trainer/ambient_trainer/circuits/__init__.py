"""A circuit is data; one function makes A, B, C, D and their derivatives of it."""
