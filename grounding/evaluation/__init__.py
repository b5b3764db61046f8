"""Grounders over many episodes: with which settings, on which maps, and the scored answers."""
