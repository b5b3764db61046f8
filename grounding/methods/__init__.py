"""Grounding methods beyond the baselines and RPG."""
