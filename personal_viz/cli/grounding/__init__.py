"""Verbs of grounding: explore, map, ground, report; and recordings of explorations and maps."""
