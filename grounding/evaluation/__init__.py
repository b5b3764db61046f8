"""Runs grounders over many episodes: settings, maps and scored answers."""
