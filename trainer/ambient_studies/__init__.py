"""Studies of the thesis and of the simulated phone; they use the API of ``ambient_trainer``, nothing uses them."""
