"""Verbs that make run folders, bring them in and out, and show what is in them."""
