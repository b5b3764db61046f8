"""What it costs and how well it agrees: benchmarks, and laboratory code that only judges homes or methods."""
