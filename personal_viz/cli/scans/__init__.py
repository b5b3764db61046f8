"""Verbs on scans: whether they fit the episodes, a look at any of them, and episodes of your own on them."""
