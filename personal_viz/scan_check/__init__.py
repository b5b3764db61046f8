"""Whether scans on disk fit the episodes of a dataset: what `check-scans` measures, and its page."""
