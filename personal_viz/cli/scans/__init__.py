"""Verbs on scans: whether they fit the episodes, and a look at any of them."""
