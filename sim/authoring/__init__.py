"""Making episodes on a home: owners, descriptions, starts, and who can be told apart."""
