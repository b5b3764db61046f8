"""OneMap: a map of picture features in which an agent looks for a described thing."""
