"""Examples, each one run by a test."""
