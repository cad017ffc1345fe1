"""Effects: the vocabulary, one record an effect."""
