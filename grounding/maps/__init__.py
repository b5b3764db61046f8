"""Maps of a home: how they are built from views or from ground truth, and how they are stored."""
