"""How wrong a model is, on data that it did not see."""
