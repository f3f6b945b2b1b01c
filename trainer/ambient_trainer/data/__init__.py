"""Traces as arrays: read, cut, imported from other formats, laid on a uniform grid."""
