"""Exports a study's records as tables and run folders, and verifies them."""
