"""The records of a study: one writer, people and their stages, leases, and append-only tables."""
