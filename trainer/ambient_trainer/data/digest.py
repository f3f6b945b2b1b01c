"""A trace is known by the SHA-256 of its file: a model says so what it was trained on."""

from __future__ import annotations

import hashlib


def sha256_of(path: str) -> str:
    """The SHA-256 of the file's bytes, in lower-case hexadecimal."""
    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        while block := stream.read(2**20):
            digest.update(block)
    return digest.hexdigest()
