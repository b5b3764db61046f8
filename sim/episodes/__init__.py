"""The released files and what is in them: schema, dataset, checks, statistics, ownership."""
