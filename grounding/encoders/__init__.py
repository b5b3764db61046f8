"""Encoders turn texts and pictures into vectors: the protocol, the encoders known by name, one file per model."""
