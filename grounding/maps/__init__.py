"""What maps of a home are made of and how they are stored."""
