"""Oracle maps: made of the episode files, with noise where asked."""
