"""Behaviour that a rebuild must not change: the program's answers must equal the stored ones of commit 0d21b8b."""
