"""Runs and answers as Rerun recordings."""
