"""Encoders of texts and pictures, one module each."""
