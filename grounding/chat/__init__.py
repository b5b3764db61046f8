"""Chat models with pictures: one protocol, an OpenAI-compatible endpoint, its cache, its budget and its transcript."""
