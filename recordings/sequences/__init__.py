"""Recordings of home sequences: any number of runs of one sequence beside each other."""
