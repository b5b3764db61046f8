"""Texts for people: every rule, key, limit and text of a study has one source, a template filled from its file."""
