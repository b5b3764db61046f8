"""One lexicon of synonyms, colours, materials, patterns, prepositions and rooms, and captions read with it."""
