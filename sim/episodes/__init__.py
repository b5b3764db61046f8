"""The released episode files: schema, dataset, checks, statistics, ownership."""
