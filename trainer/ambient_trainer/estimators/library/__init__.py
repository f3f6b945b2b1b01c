"""One estimator, one file: a module here is a plug-in, and a recipe in YAML is one, too.

A module holds ``NAMES``, the names that it offers, and ``find(name)``: the estimator of that name, or None.
"""
