"""Measures costs and agreement: benchmarks, and laboratory code that only judges homes or methods."""
