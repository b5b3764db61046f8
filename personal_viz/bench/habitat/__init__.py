"""Measures how closely we agree with a real Habitat's answers."""
