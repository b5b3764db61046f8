"""Makes episodes for a home: owners, descriptions, starts, and a check that targets can be found."""
