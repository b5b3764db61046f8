"""Texts and pictures to vectors: the protocol, the encoders known by name, one file per model."""
