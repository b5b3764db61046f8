"""The report of grounding runs: a gallery of failures, figures, pages and tables for programs."""
