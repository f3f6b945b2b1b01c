"""From phone to phone: a model of one unit on others of the same make, with and without a case, and its correction."""
