"""What a circuit gets wrong about measured data: shown, named, added to the circuit, and measured on other data."""
