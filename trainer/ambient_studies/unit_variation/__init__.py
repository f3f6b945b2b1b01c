"""Unit-to-unit variation: a model of one unit on others, with and without a case, and with each unit's correction."""
