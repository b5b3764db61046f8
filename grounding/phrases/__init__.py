"""Sources of phrases "X owns Y in Z": the dataset, rules, or a language model."""
