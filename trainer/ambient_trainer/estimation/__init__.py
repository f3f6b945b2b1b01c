"""From traces to parameters: discretisation, signals, separable least squares, uncertainty."""
