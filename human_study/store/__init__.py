"""What a study keeps: one writer, people and their stages, leases, and records that nobody can change."""
