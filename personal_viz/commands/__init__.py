"""Workers of the command line, one module per group of verbs; imported after parsing."""
