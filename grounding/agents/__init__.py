"""Agents that explore: they see observations only."""
