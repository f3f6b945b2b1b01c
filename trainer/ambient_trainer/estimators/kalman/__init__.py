"""What the two observers of the ambient search: the Kalman filter of a circuit, and the constrained free filter."""
