"""Measures maps of a robot's recordings on simulated handheld walks, whose truth is known."""
